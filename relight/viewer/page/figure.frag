#version 300 es
precision highp float;
precision highp sampler2D;

// One pixel of the stage: the figure under a light, over a background. Colours as in relight/photos/color.py.
uniform sampler2D transportA, transportB, transportC, surface, photo, front, excess, panorama;
uniform vec3 light[9], photoLight[9], backdrop;
uniform vec4 box;         // left, top, width, height of the maps in the image, pixels
uniform vec3 placement;   // image x, y of the stage's top-left corner; image pixels per stage pixel
uniform vec2 image, stage;
uniform float exposure, split, floorOfRatio, grain, panoramaGain;
uniform mat3 toPanorama;   // from camera directions to those of the panorama before it was turned
uniform int view, before, background;
uniform bool useRatio, hasPhoto;
out vec4 color;

const int RELIT = 0, PHOTO = 1, ALBEDO = 2, SHADING = 3, AO = 4, NORMAL = 5, OPEN = 6;
const int STUDIO = 0, COLOR = 1, CLEAR = 2, OWN = 3, LIGHT = 4;
const float KNEE = 0.8, FADE = 0.06, DISPLAY = 0.5, NOISE = 0.001, BLACK_GAIN = 2.0;

vec3 decode(vec3 v) { return mix(v / 12.92, pow((max(v, 0.04045) + 0.055) / 1.055, vec3(2.4)), step(0.04045, v)); }

vec3 encode(vec3 v) {
  v = clamp(v, 0.0, 1.0);
  return mix(12.92 * v, 1.055 * pow(max(v, 0.0031308), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
}

float largest(vec3 v) { return max(max(v.r, v.g), v.b); }

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
  gain = min(gain, 1.0) + raised / (1.0 + raised / (BLACK_GAIN + pow(largest(own) / NOISE, 2.0)));
  float white = max(largest(gain), 1.0);
  return rolled(own * gain * (1.0 + above * max(1.0 - gain, 0.0)), 1.0 - (1.0 - KNEE) / (white - KNEE));
}

float[9] basis(vec3 n) {
  return float[9](0.282095, 0.488603 * n.y, 0.488603 * n.z, 0.488603 * n.x, 1.092548 * n.x * n.y, 1.092548 * n.y * n.z,
                  0.315392 * (3.0 * n.z * n.z - 1.0), 1.092548 * n.x * n.z, 0.546274 * (n.x * n.x - n.y * n.y));
}

// Light that arrives on an open surface: what a renderer without this transport would show.
vec3 irradiance(vec3 normal) {
  float Y[9] = basis(normal);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < 9; k++) sum += (k == 0 ? 3.1415927 : k < 4 ? 2.0943951 : 0.7853982) * Y[k] * light[k];
  return max(sum, 0.0);
}

vec3 shading(vec4 a, vec4 b, float c, vec3 L[9]) {
  vec3 first = a.x * L[0] + a.y * L[1] + a.z * L[2] + a.w * L[3];
  return max(first + b.x * L[4] + b.y * L[5] + b.z * L[6] + b.w * L[7] + c * L[8], 0.0);
}

vec3 normalAt(vec2 e) {
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  return normalize(n);
}

// Linear values of the figure, in [0,1].
vec3 figure(int shown, vec2 uv, vec3 own, vec3 albedo) {
  vec4 a = texture(transportA, uv), b = texture(transportB, uv), c = texture(transportC, uv);
  if (shown == ALBEDO) return albedo;
  if (shown == AO) return decode(vec3(c.y));
  if (shown == NORMAL) return decode(0.5 * normalAt(c.zw) + 0.5);
  if (shown == PHOTO) return own;
  if (shown == OPEN) return rolled(exposure * albedo * irradiance(normalAt(c.zw)), 1.0);
  vec3 lit = shading(a, b, c.x, light);
  if (shown == SHADING) return rolled(DISPLAY * exposure * lit, 1.0);
  if (!useRatio) return rolled(exposure * albedo * lit, 1.0);
  vec3 gain = max(lit, floorOfRatio) / max(shading(a, b, c.x, photoLight), floorOfRatio);
  return relit(own, exposure * gain, texture(excess, uv).rgb);
}

float noise(vec2 p) { return fract(52.9829189 * fract(dot(p, vec2(0.06711056, 0.00583715)))) - 0.5; }

vec3 studio(vec2 onStage) { // coded
  float far = length((onStage / stage - vec2(0.5, 0.42)) * vec2(min(stage.x / stage.y, 1.6), 1.0));
  return mix(vec3(0.205, 0.210, 0.225), vec3(0.045, 0.047, 0.055), smoothstep(0.0, 0.85, far));
}

// Linear values behind the figure: of a light with a panorama, the panorama; else the light as blurred by a cosine lobe,
// since nine coefficients alone ring below 0 and would leave black holes. Pictures are albedo times irradiance, so
// radiance is shown times pi: a white figure in even light is as bright as what is behind it. The camera sees 50 degrees
// along the longer side, as in relight/photos/background.py.
vec3 behind(vec2 at, vec2 onStage) {
  if (background == COLOR) return decode(backdrop);
  if (background != LIGHT) return decode(studio(onStage));
  vec2 view = 0.46630766 * (2.0 * at - image) / max(image.x, image.y);
  vec3 toward = normalize(vec3(view.x, -view.y, -1.0));
  if (panoramaGain == 0.0) return rolled(exposure * irradiance(toward), 1.0);
  vec3 d = toPanorama * toward;
  vec2 uv = vec2(atan(d.x, -d.z) / 6.2831853 + 0.5, acos(clamp(d.y, -1.0, 1.0)) / 3.1415927);
  return rolled(exposure * 3.1415927 * panoramaGain * max(textureLod(panorama, uv, 0.0).rgb, 0.0), 1.0);
}

void main() {
  vec2 onStage = vec2(gl_FragCoord.x, stage.y - gl_FragCoord.y);
  vec2 at = placement.xy + onStage * placement.z;
  vec2 uv = (at - box.xy) / box.zw;
  bool inFrame = all(greaterThanEqual(at, vec2(0.0))) && all(lessThanEqual(at, image));
  bool inBox = all(greaterThanEqual(uv, vec2(0.0))) && all(lessThanEqual(uv, vec2(1.0)));
  vec4 surfaceAt = texture(surface, uv);
  float coverage = inBox ? surfaceAt.a : 0.0;
  bool isOwn = background == OWN && hasPhoto && inFrame;
  float dither = grain * noise(gl_FragCoord.xy) / 255.0;
  if (coverage == 0.0 && !isOwn && (background == STUDIO || background == OWN)) { // most of the stage, and cheap
    color = vec4(studio(onStage) + dither, 1.0);
    return;
  }
  vec3 original = hasPhoto ? decode(texture(photo, at / image).rgb) : vec3(0.0);
  vec3 own = texture(front, uv).rgb; // linear already
  int shown = onStage.x < split ? before : view;
  vec3 linear = coverage > 0.0 ? figure(shown, uv, own, surfaceAt.rgb) : vec3(0.0);
  if (background == CLEAR) {
    color = vec4(encode(linear) * coverage, coverage);
    return;
  }
  // What lies behind a soft edge of the photo is not known: the figure's share is replaced.
  if (isOwn) linear = original + coverage * (linear - own);
  else if (coverage < 1.0) linear = mix(behind(at, onStage), linear, coverage);
  color = vec4(encode(linear) + (coverage == 0.0 && background == LIGHT ? dither : 0.0), 1.0);
}
