precision highp float;
precision highp sampler2D;

// One pixel of the stage: what is behind the figure, the figure under a light, or both at its edge. Colors as in
// relight/photos/tone.py. render.js defines the constants PART, VIEW, BACKGROUND, USE_RATIO and IS_CLIPPED, one program
// for each case: in software, a GPU's stand-in computes all branches that the compiler leaves.
uniform sampler2D transportA, transportB, transportC, surface, photo, front, excess, panorama, picture;
struct Light { mat4x3 first, second; vec3 last; }; // nine coefficients of red, green and blue
uniform Light light, photoLight;
uniform vec3 backdrop, pictureTint;
uniform vec4 box;         // left, top, width, height of the maps in the image, pixels
uniform vec3 placement;   // image x, y of the stage's top-left corner; image pixels per stage pixel
uniform vec4 cover;       // left, top, width, height of the picture's part in the image, shares
uniform vec2 image, stage;
uniform float exposure, floorOfRatio, grain, panoramaGain;
uniform mat3 toPanorama;   // from camera directions to those of the panorama before it was turned
out vec4 color;

const int BEHIND = 0, EDGE = 1, INSIDE = 2;
const int RELIT = 0, PHOTO = 1, ALBEDO = 2, SHADING = 3, AO = 4, NORMAL = 5, OPEN = 6;
const int STUDIO = 0, COLOR = 1, CLEAR = 2, OWN = 3, LIGHT = 4, PANORAMA = 5, PICTURE = 6;
const float KNEE = 0.8, FADE = 0.06, DISPLAY = 0.5, NOISE = 0.001, BLACK_GAIN = 2.0, DARK = 0.15;
const vec3 LUMA = vec3(0.2126, 0.7152, 0.0722);

vec3 decode(vec3 v) { return mix(v / 12.92, pow((max(v, 0.04045) + 0.055) / 1.055, vec3(2.4)), step(0.04045, v)); }

vec3 encode(vec3 v) {
  v = clamp(v, 0.0, 1.0);
  return mix(12.92 * v, 1.055 * pow(max(v, 0.0031308), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
}

float largest(vec3 v) { return max(max(v.r, v.g), v.b); }

float square(float v) { return v * v; }

// Light -> linear values in [0,1]. bend: 0 where the light reaches 1 at most, 1 where there is no bound.
vec3 rolled(vec3 light, float bend) {
  float peak = largest(light), above = max(peak - KNEE, 0.0) / (1.0 - KNEE);
  float top = min(peak, KNEE) + (1.0 - KNEE) * above / (1.0 + bend * above);
  float fade = 1.0 - 1.0 / (1.0 + FADE * max(peak - top, 0.0));
  return light * (1.0 - fade) * top / max(peak, 1e-9) + fade * top;
}

// The photo's linear values under `gain` times the light; what was clipped is rebuilt where the gain is below 1, and what
// is noise is raised little where it is above.
vec3 relit(vec3 own, vec3 gain, vec3 above) {
  vec3 raised = max(gain - 1.0, 0.0);
  gain = min(gain, 1.0) + raised / (1.0 + raised / (BLACK_GAIN + square(largest(own) / NOISE)));
  float white = max(largest(gain), 1.0);
  return rolled(own * gain * (1.0 + above * max(1.0 - gain, 0.0)), 1.0 - (1.0 - KNEE) / (white - KNEE));
}

// Shading by nine coefficients of transport: a, b and c. (A macro: in software a function copies the light.)
#define SHADING(L, a, b, c) max(L.first * (a) + L.second * (b) + L.last * (c), 0.0)

// Dark shading in the color of its light as a whole (`mean`: coefficient 0): relight/photos/shading.py.
vec3 steady(vec3 lit, vec3 mean, float least) {
  mean = max(mean, 0.0);
  float brightness = max(dot(LUMA, mean), 1e-6), level = dot(LUMA, lit);
  float share = clamp(2.0 - level / max(max(DARK * 0.886227 * brightness, least), 1e-6), 0.0, 1.0);
  return mix(lit, max(level, least) * mean / brightness, share);
}

// Light that arrives on an open surface: what a renderer without this transport would show.
vec3 irradiance(vec3 n) {
  vec4 a = vec4(0.886227, 1.023327 * n.yzx), b = 0.858085 * vec4(n.x * n.y, n.y * n.z, 0.0, n.x * n.z);
  b.z = 0.247708 * (3.0 * n.z * n.z - 1.0);
  return SHADING(light, a, b, 0.429043 * (n.x * n.x - n.y * n.y));
}

vec3 normalAt(vec2 e) {
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  return normalize(n);
}

// Linear values of the figure in [0,1]. own: those of the photo.
vec3 figure(vec2 uv, vec3 own) {
  if (VIEW == PHOTO) return own;
  if (VIEW == ALBEDO) return texture(surface, uv).rgb;
  vec4 c = texture(transportC, uv);
  if (VIEW == AO) return decode(vec3(c.y));
  if (VIEW == NORMAL) return decode(0.5 * normalAt(c.zw) + 0.5);
  if (VIEW == OPEN) return rolled(exposure * texture(surface, uv).rgb * irradiance(normalAt(c.zw)), 1.0);
  vec4 a = texture(transportA, uv), b = texture(transportB, uv);
  vec3 lit = SHADING(light, a, b, c.x);
  if (VIEW == SHADING || !USE_RATIO) {
    lit = steady(lit, light.first[0], 0.0);
    return rolled(exposure * (VIEW == SHADING ? vec3(DISPLAY) : texture(surface, uv).rgb) * lit, 1.0);
  }
  vec3 was = steady(SHADING(photoLight, a, b, c.x), photoLight.first[0], floorOfRatio), lacking = max(floorOfRatio - was, 0.0);
  vec3 gain = (steady(lit, light.first[0], floorOfRatio) + lacking) / (was + lacking);
  return relit(own, exposure * gain, IS_CLIPPED ? texture(excess, uv).rgb : vec3(0.0));
}

float dither() { return grain * (fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715)))) - 0.5) / 255.0; }

vec3 studio(vec2 onStage) {
  float far = length((onStage / stage - vec2(0.5, 0.42)) * vec2(min(stage.x / stage.y, 1.6), 1.0));
  return mix(vec3(0.205, 0.210, 0.225), vec3(0.045, 0.047, 0.055), smoothstep(0.0, 0.85, far)) + dither();
}

// Coded values behind the figure. Of a light without a panorama the light as blurred by a cosine lobe, since nine
// coefficients alone ring below 0 and would leave black holes. Pictures are albedo times irradiance, so radiance is shown
// times pi: a white figure in even light is as bright as what is behind it. The camera sees 50 degrees along the longer
// side, as in relight/photos/background.py.
vec3 behind(vec2 at, vec2 onStage) {
  if (BACKGROUND == STUDIO) return studio(onStage);
  if (BACKGROUND == COLOR) return backdrop;
  if (BACKGROUND == OWN || BACKGROUND == PICTURE) {
    if (any(lessThan(at, vec2(0.0))) || any(greaterThan(at, image))) return studio(onStage);
    if (BACKGROUND == OWN) return texture(photo, at / image).rgb;
    vec2 lod = vec2(textureSize(picture, 0)) * cover.zw / image * placement.z; // derivatives are undefined in a branch
    return encode(relit(decode(textureLod(picture, cover.xy + at / image * cover.zw, log2(max(lod.x, lod.y))).rgb), exposure * pictureTint, vec3(0.0)));
  }
  vec2 view = 0.46630766 * (2.0 * at - image) / max(image.x, image.y);
  vec3 toward = normalize(vec3(view.x, -view.y, -1.0)), d = toPanorama * toward, radiance;
  if (BACKGROUND == LIGHT) {
    radiance = irradiance(toward);
  } else {
    vec2 uv = vec2(atan(d.x, -d.z) / 6.2831853 + 0.5, acos(clamp(d.y, -1.0, 1.0)) / 3.1415927);
    radiance = 3.1415927 * panoramaGain * max(textureLod(panorama, uv, 0.0).rgb, 0.0);
  }
  return encode(rolled(exposure * radiance, 1.0)) + dither();
}

void main() {
  vec2 onStage = vec2(gl_FragCoord.x, stage.y - gl_FragCoord.y);
  vec2 at = placement.xy + onStage * placement.z;
  if (PART == BEHIND) {
    color = BACKGROUND == CLEAR ? vec4(0.0) : vec4(behind(at, onStage), 1.0);
    return;
  }
  vec2 uv = (at - box.xy) / box.zw;
  vec3 own = texture(front, uv).rgb; // linear already
  vec3 linear = figure(uv, own);
  float coverage = 1.0;
  if (PART == EDGE) coverage = texture(surface, uv).a;
  if (PART == EDGE && BACKGROUND != CLEAR) {
    vec3 back = decode(behind(at, onStage));
    // What lies behind a soft edge of the photo is not known: the figure's share is replaced.
    linear = BACKGROUND == OWN ? back + coverage * (linear - own) : mix(back, linear, coverage);
  }
  color = BACKGROUND == CLEAR ? vec4(encode(linear) * coverage, coverage) : vec4(encode(linear), 1.0);
}
