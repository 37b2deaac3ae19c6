// The only shader of the stage. It draws a pane of golden, frame, difference or map. It works in pixels of the canvas
// and fetches texels. If a texel covers at least a pixel, nothing is filtered. If it covers less, the colours of texels
// are averaged, and marks and differences stay visible. Each choice in a menu is a constant, and has its own program,
// because software drivers compute all branches of a choice.

const VERTEX = `#version 300 es
void main() { // one triangle over the whole viewport
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

const fragment = ({ layer, tone, channel, falseColor, relative, how, scalarMap, samples }) => `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D golden, actual, map;
uniform ivec2 goldenSize, actualSize, mapSize;
uniform vec2 origin;      // the image's top left corner, in pixels of the canvas from the top left
uniform float scale;      // pixels of the canvas per texel
uniform float height;     // the height of the canvas
uniform float exposure;   // the factor for colours
uniform bool marks;
uniform bool grid;
uniform float gain;       // the factor for differences
uniform float dark;       // in relative differences, darker pixels count as this bright
uniform vec2 range;       // the values of a map at the ends of the false colours
out vec4 shown;

const int layer = ${layer};         // 0 golden, 1 actual, 2 difference, 3 map
const int tone = ${tone};           // the index in tones.all
const int channel = ${channel};     // 0 rgb, 1 r, 2 g, 3 b, 4 a, 5 luminance
const bool falseColor = ${falseColor};
const bool relative = ${relative};  // differences divided by the golden
const int how = ${how};             // 0 signed, largest; 1 signed by channel; 2 absolute by channel
const bool scalarMap = ${scalarMap};
const int n = ${samples};           // on each axis of a pixel

const float STOPS = ${tones.STOPS}.0;
const vec3 MAGENTA = vec3(1, 0, 1), YELLOW = vec3(1, 1, 0), CYAN = vec3(0, 1, 1);

// This tests the bits, because compilers may assume that there is no NaN.
bvec4 nan(vec4 x) { return greaterThan(floatBitsToUint(x) & 0x7fffffffu, uvec4(0x7f800000u)); }
bvec4 infinite(vec4 x) { return equal(floatBitsToUint(x) & 0x7fffffffu, uvec4(0x7f800000u)); }

float luminance(vec3 c) { return dot(c, vec3(0.2126, 0.7152, 0.0722)); } // ITU-R BT.709

vec3 encode(vec3 x) { // IEC 61966-2-1
  return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

vec3 agx(vec3 c) { // Wrensch 2023; see tones.js
  const mat3 inset = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051,
    0.0784335999999992, 0.878468636469772, 0.0784336,
    0.0792237451477643, 0.0791661274605434, 0.879142973793104);
  const mat3 outset = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438,
    -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
    -0.0990297440797205, -0.0989611768448433, 1.15107367264116);
  vec3 x = clamp((log2(max(inset * c, 1e-10)) + 12.47393) / 16.5, 0.0, 1.0);
  x = (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232;
  return encode(pow(clamp(outset * x, 0.0, 1.0), vec3(2.2)));
}

vec3 toned(vec3 c) {
  c = clamp(c, 0.0, 1e15); // the fits square it, and infinity divided by infinity isn't white
  if (tone == 3) return agx(c);
  if (tone == 1) c = c / (1.0 + c);                                            // Reinhard 2002, eq. 3
  if (tone == 2) c = (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14); // Narkowicz 2016
  return encode(clamp(c, 0.0, 1.0));
}

vec3 turbo(float t) { // Mikhailov 2019
  float x = clamp(t, 0.0, 1.0);
  vec4 v4 = vec4(1.0, x, x * x, x * x * x);
  vec2 v2 = v4.zw * v4.z;
  return clamp(vec3(
    dot(v4, vec4(0.13572138, 4.61539260, -42.66032258, 132.13108234)) + dot(v2, vec2(-152.94239396, 59.28637943)),
    dot(v4, vec4(0.09140261, 2.19418839, 4.84296658, -14.18503333)) + dot(v2, vec2(4.27729857, 2.82956604)),
    dot(v4, vec4(0.10667330, 12.64194608, -60.58204836, 110.36276771)) + dot(v2, vec2(-89.90310912, 27.34824973))
  ), 0.0, 1.0);
}

vec3 diverging(float value) {
  float over = abs(value) > 1.0 ? 0.55 : 0.0;
  vec3 hue = value > 0.0 ? vec3(1.0, 0.5, 0.1) : vec3(0.2, 0.55, 1.0);
  return mix(hue * sqrt(min(abs(value), 1.0)), vec3(1.0), over);
}

// The selected channels. Other channels can't be marked.
bvec4 looked() {
  if (channel == 0) return bvec4(true);
  if (channel == 5) return bvec4(true, true, true, false);
  return bvec4(channel == 1, channel == 2, channel == 3, channel == 4);
}

vec3 picked(vec4 c) {
  if (channel == 0) return c.rgb;
  return vec3(channel == 5 ? luminance(c.rgb) : c[max(channel - 1, 0)]);
}

bool both(bvec4 a, bvec4 b) { return any(bvec4(a.x && b.x, a.y && b.y, a.z && b.z, a.w && b.w)); }

// The colour of a mark. w is 3 for NaN, 2 for infinity, 1 for a negative value, and 0 for no mark.
vec4 mark(vec4 c) {
  if (both(nan(c), looked())) return vec4(MAGENTA, 3.0);
  if (both(infinite(c), looked())) return vec4(YELLOW, 2.0);
  if (both(lessThan(c, vec4(0.0)), looked())) return vec4(CYAN, 1.0);
  return vec4(0.0);
}

vec3 seen(vec4 c) {
  vec3 light = picked(c) * exposure;
  if (falseColor) {
    float level = log2(max(luminance(light), 1e-30) / 0.18);
    return turbo((level / STOPS + 1.0) / 2.0);
  }
  return channel == 4 ? encode(clamp(picked(c), 0.0, 1.0)) : toned(light); // alpha isn't exposed
}

// The difference of each colour. With one channel, all three colours have its difference.
vec3 difference(vec4 g, vec4 a) {
  vec3 d = picked(a) - picked(g);
  // Alpha isn't light: exposure and darkness don't apply to it.
  vec3 by = relative ? max(abs(picked(g)), channel == 4 ? 0.01 : dark) : vec3(1.0 / (channel == 4 ? 1.0 : exposure));
  return gain * d / by;
}

vec3 coloured(vec3 d) { // see tones.js
  vec3 root = sqrt(min(abs(d), 1.0));
  vec3 hue = channel == 1 ? vec3(1.0, 0.15, 0.15) : channel == 2 ? vec3(0.15, 1.0, 0.15)
    : channel == 3 ? vec3(0.25, 0.35, 1.0) : vec3(1.0);
  if (how == 2) return root * hue;
  if (how == 1) return 0.5 + 0.5 * sign(d) * root * (2.0 * hue - 1.0);
  float most = abs(d.y) > abs(d.x) ? d.y : d.x;
  return diverging(abs(d.z) > abs(most) ? d.z : most);
}

void main() {
  vec2 pixel = vec2(gl_FragCoord.x, height - gl_FragCoord.y) - origin;
  ivec2 size = layer == 0 ? goldenSize : layer == 1 ? actualSize : layer == 3 ? mapSize : min(goldenSize, actualSize);
  vec2 at = pixel / scale;
  if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, vec2(size)))) {
    shown = vec4(vec3(0.117), 1.0); // the surround: neutral, as dark as the page
    return;
  }
  vec3 sum = vec3(0.0);
  vec4 marked = vec4(0.0);
  vec3 most = vec3(0.0);
  for (int j = 0; j < n; j++) {
    for (int i = 0; i < n; i++) {
      vec2 within = (vec2(i, j) + 0.5) / float(n) - 0.5;
      ivec2 texel = n == 1 ? ivec2(at) : ivec2((pixel + within) / scale);
      texel = clamp(texel, ivec2(0), size - 1);
      vec4 g = layer == 1 || layer == 3 ? vec4(0.0) : texelFetch(golden, texel, 0);
      vec4 a = layer == 0 || layer == 3 ? vec4(0.0) : texelFetch(actual, texel, 0);
      vec4 c = layer == 0 ? g : layer == 1 ? a : layer == 3 ? texelFetch(map, texel, 0) : vec4(0.0);
      vec4 m = mark(layer == 2 ? g : c);
      if (layer == 2) {
        vec4 other = mark(a);
        if (other.w > m.w) m = other;
        if (m.w < 2.0) m = vec4(0.0); // a difference may be negative
      }
      if (layer == 3 && scalarMap && m.w < 2.0) m = vec4(0.0); // a scalar may be negative, too
      if (m.w > marked.w) marked = m;
      vec3 d = layer == 2 ? difference(g, a) : vec3(0.0);
      most = mix(most, d, greaterThan(abs(d), abs(most)));
      // A pixel without a value is black, like a pixel without a difference.
      vec3 level = c.a == 0.0 ? vec3(0.0) : turbo((c.r - range.x) / (range.y - range.x));
      sum += layer == 3 && scalarMap ? level : seen(c);
    }
  }
  vec3 color = layer == 2 ? coloured(most) : sum / float(n * n);
  bool mandatory = marked.w >= 2.0; // NaN and infinity have no colour
  if (marked.w > 0.0 && (marks || mandatory)) color = marked.rgb;
  if (grid) {
    ivec2 tile = ivec2(floor(at / 16.0));
    ivec2 before = ivec2(floor((pixel - 1.0) / scale / 16.0));
    if (16.0 * scale >= 5.0 && any(notEqual(tile, before))) color = mix(color, vec3(0.6), 0.5);
  }
  shown = vec4(color, 1.0);
}`;
