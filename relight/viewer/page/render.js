// WebGL2: a figure's textures and one triangle. Draws to the page's canvas, or to pixels of the image's own size.

const VIEWS = ["relit", "photo", "albedo", "shading", "ao", "normal", "open"];
const BACKGROUNDS = ["studio", "color", "clear", "photo", "light"];

const IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

const VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

export class Renderer {
  constructor(canvas, fragment) {
    this.canvas = canvas;
    this.fragment = fragment;
    this.gl = canvas.getContext("webgl2", { antialias: false, alpha: true, powerPreference: "high-performance" });
    if (!this.gl) throw new Error("This browser has no WebGL2, which the viewer draws with.");
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.build();
      if (this.figure) this.show(this.figure);
      canvas.dispatchEvent(new Event("redraw"));
    });
    this.build();
  }

  build() {
    const gl = this.gl, program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, this.fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error([gl.getProgramInfoLog(program), ...logs].join(" "));
    }
    gl.useProgram(program);
    this.at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    const samplers = ["transportA", "transportB", "transportC", "surface", "photo", "front", "excess", "panorama"];
    samplers.forEach((name, i) => gl.uniform1i(this.at[name], i));
    // Half floats cost up to one code more in the dark, where a phone cannot filter full ones.
    this.float = gl.getExtension("OES_texture_float_linear") ? gl.RGBA32F : gl.RGBA16F;
    this.textures = samplers.map(() => gl.createTexture());
    this.panorama = null;
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

  bind(unit) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[unit]);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  // scene: light, view, before, split (stage pixels), background, backdrop, exposure, ratio, panorama (of the light, with
  // gain and rotation). placement: [x, y, image pixels per stage pixel] of the stage's top-left corner in the image.
  draw(scene, placement, width, height, grain = 1) {
    const { gl, at, figure } = this;
    const { panorama } = scene, isShown = panorama && scene.background === "light";
    if (isShown && this.panorama !== panorama.pixels) this.showPanorama(panorama);
    gl.viewport(0, 0, width, height);
    gl.uniform1f(at.panoramaGain, isShown ? panorama.gain : 0);
    gl.uniformMatrix3fv(at.toPanorama, false, Float32Array.from((panorama?.rotation ?? IDENTITY).flat()));
    gl.uniform3fv(at.light, Float32Array.from(scene.light));
    gl.uniform3fv(at.photoLight, Float32Array.from(figure.light ? figure.light.flat() : new Float32Array(27)));
    gl.uniform3fv(at.backdrop, scene.backdrop);
    gl.uniform4fv(at.box, figure.box);
    gl.uniform3fv(at.placement, placement);
    gl.uniform2f(at.image, figure.width, figure.height);
    gl.uniform2f(at.stage, width, height);
    gl.uniform1f(at.exposure, scene.exposure);
    gl.uniform1f(at.split, scene.split ?? -1);
    gl.uniform1f(at.floorOfRatio, figure.floor ?? 1);
    gl.uniform1f(at.grain, grain);
    gl.uniform1i(at.view, VIEWS.indexOf(scene.view));
    gl.uniform1i(at.before, VIEWS.indexOf(scene.before ?? scene.view));
    gl.uniform1i(at.background, BACKGROUNDS.indexOf(scene.background));
    gl.uniform1i(at.useRatio, scene.ratio && figure.light ? 1 : 0);
    gl.uniform1i(at.hasPhoto, figure.photo ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // RGBA bytes (not premultiplied, row 0 at the top) of the picture at the image's own size.
  pixels(scene) {
    const { gl, figure: { width, height } } = this;
    const target = gl.createTexture(), frame = gl.createFramebuffer(), pixels = new Uint8Array(4 * width * height);
    gl.activeTexture(gl.TEXTURE8);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    this.draw(scene, [0, 0, 1], width, height, 0);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
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
