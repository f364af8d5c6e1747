// A picture file as RGBA bytes, straight alpha, upright and in sRGB.

const LONGEST = 4096; // pixels: larger photos are scaled down by the browser, for textures have a largest size

function isPicture(file) {
  return file.type.startsWith("image/") && !/\.(hdr|pic|rgbe|xyze|exr)$/i.test(file.name);
}

async function readPhoto(file, longest = LONGEST) {
  const straight = { premultiplyAlpha: "none" };
  let bitmap = await createImageBitmap(file, straight).catch(() => null);
  if (!bitmap) throw new Error(`${file.name} is no picture that this browser reads: give JPEG, PNG or WebP.`);
  if (Math.min(bitmap.width, bitmap.height) < 8) throw new Error(`${file.name} is smaller than 8 pixels a side.`);
  const scale = longest / Math.max(bitmap.width, bitmap.height);
  if (scale < 1) {
    const [resizeWidth, resizeHeight] = [bitmap.width, bitmap.height].map((side) => Math.max(Math.round(side * scale), 1));
    bitmap = await createImageBitmap(bitmap, { ...straight, resizeWidth, resizeHeight, resizeQuality: "high" });
  }
  return { pixels: straightPixels(bitmap), width: bitmap.width, height: bitmap.height };
}

// Through WebGL, for a 2D canvas multiplies colors by alpha and rounds.
function straightPixels(bitmap) {
  const { width, height } = bitmap, gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) throw new Error("The browser gives no further WebGL2 context: reload the page.");
  const pixels = new Uint8Array(4 * width * height);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, gl.getParameter(gl.TEXTURE_BINDING_2D), 0);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return pixels;
}

// RGBA bytes on white, as relight/photos/tone.py has them.
function onWhite(pixels) {
  return Uint8ClampedArray.from(pixels, (v, i) => (i % 4 === 3 ? 255 : 255 + (pixels[i | 3] / 255) * (v - 255)));
}

export { isPicture, onWhite, readPhoto };
