// WebGL2: a figure's textures, and programs that draw it. Draws to the page's canvas, or to pixels of the image's own size.

const PARTS = ["behind", "edge", "inside"];
const VIEWS = ["relit", "photo", "albedo", "shading", "ao", "normal", "open"];
const BACKGROUNDS = ["studio", "color", "clear", "photo", "light", "panorama", "picture"];
const SAMPLERS = ["transportA", "transportB", "transportC", "surface", "photo", "front", "excess", "panorama", "picture"];
const TILE = 16; // pixels of a figure's box: tiles without the figure are not drawn, those inside it without a background

const IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// What is behind is a triangle over the stage. The other parts are before it; their `corner` is in pixels of the figure's box.
const VERTEX = `
in vec2 corner;
uniform vec4 box;
uniform vec3 placement;
uniform vec2 stage;
void main() {
  vec2 covering = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  vec2 onStage = (box.xy + corner - placement.xy) / placement.z / stage;
  gl_Position = PART == 0 ? vec4(covering, 0.5, 1.0) : vec4(vec2(2.0, -2.0) * onStage + vec2(-1.0, 1.0), 0.0, 1.0);
}`;

// The tiles of a figure's box as triangles: first those with the figure's edge, then those that it fills. Neighbours of one
// kind in a row are one rectangle. Filtering reads one pixel beyond a tile. Returns the corners (x, y), three a triangle,
// and the number of corners of either kind.
export function tiles(surface, width, height) {
  const triangles = { edge: [], inside: [] };
  const kindOf = (left, top) => {
    let least = 1, most = 0;
    for (let y = Math.max(top - 1, 0); y < Math.min(top + TILE + 1, height); y++) {
      for (let x = Math.max(left - 1, 0); x < Math.min(left + TILE + 1, width); x++) {
        const coverage = surface[4 * (y * width + x) + 3];
        least = Math.min(least, coverage);
        most = Math.max(most, coverage);
      }
    }
    return least === 1 ? "inside" : most > 0 ? "edge" : "none";
  };
  for (let top = 0; top < height; top += TILE) {
    const bottom = Math.min(top + TILE, height);
    for (let left = 0, right; left < width; left = right) {
      const kind = kindOf(left, top);
      for (right = left + TILE; right < width && kindOf(right, top) === kind; ) right += TILE;
      right = Math.min(right, width);
      triangles[kind]?.push(left, top, right, top, left, bottom, left, bottom, right, top, right, bottom);
    }
  }
  const { edge, inside } = triangles;
  return { corners: Float32Array.from([...edge, ...inside]), edge: edge.length / 2, inside: inside.length / 2 };
}

export class Renderer {
  constructor(canvas, fragment) {
    this.canvas = canvas;
    this.fragment = fragment;
    this.gl = canvas.getContext("webgl2", { antialias: false, alpha: true, powerPreference: "high-performance" });
    if (!this.gl) throw new Error("This browser draws without WebGL2, which the page needs: allow hardware acceleration in its settings, or open the page in another browser.");
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.build();
      if (this.figure) this.show(this.figure);
      canvas.dispatchEvent(new Event("redraw"));
    });
    this.build();
  }

  build() {
    const { gl } = this;
    // Half floats cost up to one code more in the dark, where a phone cannot filter full ones.
    this.float = gl.getExtension("OES_texture_float_linear") ? gl.RGBA32F : gl.RGBA16F;
    this.textures = SAMPLERS.map(() => gl.createTexture());
    this.programs = new Map();
    this.panorama = this.picture = null;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.enableVertexAttribArray(0);
    this.program("inside", "relit", "studio", true, true); // a browser that cannot compile it says so at the start
  }

  // The program of a part, compiled when it is first used, and the locations of its uniforms by name.
  program(part, view, background, isRatio, isClipped) {
    const { gl } = this, ofFigure = [view, isRatio, isClipped];
    const key = [part, ...{ behind: [background], edge: [background, ...ofFigure], inside: ofFigure }[part]].join();
    if (this.programs.has(key)) return this.programs.get(key);
    const header = `#version 300 es
      const int PART = ${PARTS.indexOf(part)}, VIEW = ${VIEWS.indexOf(view)}, BACKGROUND = ${BACKGROUNDS.indexOf(background)};
      const bool USE_RATIO = ${isRatio}, IS_CLIPPED = ${isClipped};\n`;
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, this.fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, header + source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "corner");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error([gl.getProgramInfoLog(program), ...logs].join(" "));
    }
    gl.useProgram(program);
    const at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    SAMPLERS.forEach((name, i) => gl.uniform1i(at[name], i));
    this.programs.set(key, { program, at });
    return { program, at };
  }

  show(figure) {
    const gl = this.gl, [, , width, height] = figure.box;
    this.figure = figure;
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    figure.maps.forEach((map, i) => {
      this.bind(i);
      gl.texImage2D(gl.TEXTURE_2D, 0, this.float, width, height, 0, gl.RGBA, gl.FLOAT, map);
    });
    const { photo, front, excess } = figure, [w, h] = photo ? [figure.width, figure.height] : [1, 1];
    this.bind(4);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, w, h, 0, gl.RGBA, gl.UNSIGNED_BYTE, photo ?? new Uint8Array(4));
    this.bind(5);
    const size = front ? [width, height] : [1, 1];
    gl.texImage2D(gl.TEXTURE_2D, 0, this.float, ...size, 0, gl.RGBA, gl.FLOAT, front ?? new Float32Array(4));
    const clipped = excess ? [width, height] : [1, 1];
    this.bind(6);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, ...clipped, 0, gl.RGBA, gl.UNSIGNED_BYTE, excess ?? new Uint8Array(4));
    this.tiles = tiles(figure.maps[3], width, height);
    gl.bufferData(gl.ARRAY_BUFFER, this.tiles.corners, gl.STATIC_DRAW);
  }

  // The panorama behind the figure, thinned out to what a texture can hold.
  showPanorama({ width, height, pixels }) {
    const gl = this.gl, every = Math.ceil(width / Math.min(gl.getParameter(gl.MAX_TEXTURE_SIZE), 4096));
    const [w, h] = [Math.floor(width / every), Math.floor(height / every)], data = new Float32Array(4 * w * h);
    for (let i = 0, k = 0; i < h; i++) {
      for (let j = 0; j < w; j++, k += 4) {
        for (let c = 0; c < 3; c++) {
          let sum = 0;
          for (let n = 0; n < every * every; n++) {
            const row = i * every + Math.floor(n / every), column = j * every + (n % every);
            sum += pixels[3 * (row * width + column) + c];
          }
          data[k + c] = Math.min(sum / every ** 2, 65504); // the largest half float
        }
      }
    }
    this.bind(7);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.REPEAT);
    gl.texImage2D(gl.TEXTURE_2D, 0, this.float, w, h, 0, gl.RGBA, gl.FLOAT, data);
    this.panorama = pixels;
  }

  showPicture({ width, height, pixels }) {
    const { gl } = this;
    this.bind(8);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    this.picture = pixels;
  }

  // The part of the picture that covers the image: left, top, width, height as shares of the picture's.
  cover({ width, height }) {
    const scale = Math.max(this.figure.height / height, this.figure.width / width);
    const share = [this.figure.width / scale / width, this.figure.height / scale / height];
    return [...share.map((value) => (1 - value) / 2), ...share];
  }

  bind(unit) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[unit]);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  // scene: light, photoLight (that the photo was taken in), view, before, split (stage pixels), background, backdrop,
  // exposure, ratio, panorama (of the light, with gain and rotation), picture (with its tint). placement: [x, y, image
  // pixels per stage pixel] of the stage's top-left corner in the image.
  draw(scene, placement, width, height, grain = 1) {
    const { gl, figure, tiles: { edge, inside } } = this, { light, panorama } = scene;
    const has = { photo: figure.photo, picture: scene.picture }, { picture } = scene;
    const background = scene.background in has && !has[scene.background] ? "studio" : scene.background;
    const hasPanorama = background === "light" && !!panorama, isRatio = scene.ratio && !!scene.photoLight;
    if (hasPanorama && this.panorama !== panorama.pixels) this.showPanorama(panorama);
    if (background === "picture" && this.picture !== picture.pixels) this.showPicture(picture);
    const photoLight = scene.photoLight ?? new Float32Array(27);
    const drawPart = (part, view, first, count) => {
      const shown = hasPanorama ? "panorama" : background;
      const { program, at } = this.program(part, view, shown, isRatio, !!figure.excess);
      gl.useProgram(program);
      for (const [name, values] of [["light", light], ["photoLight", photoLight]]) {
        gl.uniformMatrix4x3fv(at[`${name}.first`], false, values.slice(0, 12));
        gl.uniformMatrix4x3fv(at[`${name}.second`], false, values.slice(12, 24));
        gl.uniform3fv(at[`${name}.last`], values.slice(24));
      }
      gl.uniform1f(at.panoramaGain, panorama?.gain ?? 0);
      gl.uniformMatrix3fv(at.toPanorama, false, (panorama?.rotation ?? IDENTITY).flat());
      gl.uniform3fv(at.pictureTint, picture?.tint ?? [1, 1, 1]);
      gl.uniform4fv(at.cover, picture ? this.cover(picture) : [0, 0, 1, 1]);
      gl.uniform3fv(at.backdrop, scene.backdrop);
      gl.uniform4fv(at.box, figure.box);
      gl.uniform3fv(at.placement, placement);
      gl.uniform2f(at.image, figure.width, figure.height);
      gl.uniform2f(at.stage, width, height);
      gl.uniform1f(at.exposure, scene.exposure);
      gl.uniform1f(at.floorOfRatio, figure.floor ?? 1);
      gl.uniform1f(at.grain, grain);
      gl.drawArrays(gl.TRIANGLES, first, count);
    };
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    const split = scene.before ? Math.min(Math.max(Math.ceil(scene.split - 0.5), 0), width) : 0;
    for (const [view, left, right] of [[scene.before, 0, split], [scene.view, split, width]]) {
      if (left === right) continue;
      gl.scissor(left, 0, right - left, height);
      drawPart("inside", view, edge, inside); // from front to back: what is hidden is not computed
      drawPart("edge", view, 0, edge);
      drawPart("behind", view, 0, 3);
    }
    gl.disable(gl.SCISSOR_TEST);
  }

  // RGBA bytes (not premultiplied, row 0 at the top) of the picture at the image's own size.
  pixels(scene) {
    const { gl, figure: { width, height } } = this;
    const target = gl.createTexture(), depth = gl.createRenderbuffer(), frame = gl.createFramebuffer();
    const pixels = new Uint8Array(4 * width * height);
    gl.activeTexture(gl.TEXTURE0 + SAMPLERS.length);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT16, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    this.draw(scene, [0, 0, 1], width, height, 0);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    gl.deleteRenderbuffer(depth);
    gl.deleteTexture(target);
    const upright = new Uint8ClampedArray(pixels.length);
    for (let y = 0; y < height; y++) {
      upright.set(pixels.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    }
    for (let k = 3; k < upright.length; k += 4) {
      const alpha = upright[k];
      if (alpha && alpha < 255) for (let c = 1; c < 4; c++) upright[k - c] = (upright[k - c] * 255) / alpha;
    }
    return upright;
  }
}
