// The picture: nearest, middle and farthest of 3×3 disparities as layers; where no photo confirms the disparity, it and that of what is confirmed
// around. On each the photos that see the point, by distance and by how well they agree (crates/synthesizer/src/agreement.rs); the layers by how well
// their photos agree. Alpha 0 where no photo sees anything.
uniform sampler2D surface, smaller, photos[5]; // `smaller`: the surface at half the size, of what is confirmed
uniform usampler2D codes[5];
uniform int count;
uniform float largest; // disparity of 1 in `surface`
uniform float fine; // layers closer than this are one, share of `largest`
uniform bool three; // whether the middle of what is confirmed is a layer where nearest and farthest differ from it
uniform mat3 H[5]; // photo from target: H p + d e
uniform vec3 e[5];
uniform vec2 sizes[5]; // of the photos, pixels
uniform vec4 gains[5]; // of red, green and blue; log of the weight by distance
uniform vec4 scales[5]; // of a photo's depth: step, margin of what hides (0: no depth); weight while it fades in or out; level of detail
out vec4 picture;
const float HALF_AGREEMENT = 3.0 * 0.08 * 0.08;
vec3 colours[5];
float seen[5];
void sampled(int i, sampler2D photo, usampler2D code, vec2 pixel, float disparity) {
  vec3 p = H[i] * vec3(pixel, 1.0) + disparity * e[i];
  vec2 at = p.xy / p.z;
  seen[i] = 0.0;
  colours[i] = vec3(0.0);
  if (!(p.z > 0.0 && at.x >= 0.0 && at.y >= 0.0 && at.x < sizes[i].x && at.y < sizes[i].y)) return;
  if (scales[i].y > 0.0) {
    uint found = texelFetch(code, ivec2(at), 0).r;
    if (found > 0x8000u && float(found & 0x7fffu) * scales[i].x - scales[i].x > disparity / p.z + scales[i].y) return;
  }
  seen[i] = scales[i].z;
  colours[i] = textureLod(photo, at / sizes[i], scales[i].w).rgb * gains[i].rgb;
}
// Colour, and in alpha the agreement; below 0 where no photo sees it.
vec4 layer(vec2 pixel, float disparity) {
  for (int i = 0; i < 5; i++) seen[i] = 0.0;
  sampled(0, photos[0], codes[0], pixel, disparity);
  if (count > 1) sampled(1, photos[1], codes[1], pixel, disparity);
  if (count > 2) sampled(2, photos[2], codes[2], pixel, disparity);
  if (count > 3) sampled(3, photos[3], codes[3], pixel, disparity);
  if (count > 4) sampled(4, photos[4], codes[4], pixel, disparity);
  float number = seen[0] + seen[1] + seen[2] + seen[3] + seen[4];
  if (number <= 0.0) return vec4(0.0, 0.0, 0.0, -1.0);
  float agreement[5] = float[5](seen[0], seen[1], seen[2], seen[3], seen[4]);
  for (int i = 1; i < 5; i++) {
    for (int j = 0; j < i; j++) {
      vec3 difference = colours[i] - colours[j];
      float alike = 1.0 / (1.0 + dot(difference, difference) / HALF_AGREEMENT);
      agreement[i] += seen[j] * alike;
      agreement[j] += seen[i] * alike;
    }
  }
  float per = 2.0 / max(number, 1e-3), best = -1e9, total = 0.0, mean = 0.0;
  for (int i = 0; i < 5; i++) if (seen[i] > 0.0) best = max(best, per * agreement[i] + gains[i].w);
  vec3 sum = vec3(0.0);
  for (int i = 0; i < 5; i++) {
    float weight = seen[i] > 0.0 ? seen[i] * exp(per * agreement[i] + gains[i].w - best) : 0.0;
    sum += weight * colours[i];
    total += weight;
    mean += per * agreement[i] * seen[i] / number;
  }
  return vec4(sum / total, mean);
}
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy), last = textureSize(surface, 0) - 1;
  float d[9], own, sure;
  for (int i = 0; i < 9; i++) {
    vec4 found = texelFetch(surface, clamp(p + ivec2(i % 3, i / 3) - 1, ivec2(0), last), 0);
    d[i] = unpack(found.rgb);
    if (i == 4) own = d[i], sure = found.a;
  }
  // Sorted as far as the median.
  for (int i = 0; i < 5; i++) {
    for (int j = i + 1; j < 9; j++) {
      float lower = min(d[i], d[j]);
      d[j] = max(d[i], d[j]);
      d[i] = lower;
    }
  }
  float far = d[0], middle = d[4], near = max(max(d[5], d[6]), max(d[7], d[8]));
  if (sure > 0.1 && sure < 0.9) {
    float around = unpack(texelFetch(smaller, p / 2, 0).rgb);
    near = max(own, around);
    far = min(own, around);
  }
  // A loop: software executes both sides of a branch.
  bool plain = near - far <= fine;
  vec4 sum = vec4(0.0);
  for (int i = plain || (three && sure > 0.9) ? 0 : 1; i < (plain ? 1 : 3); i++) {
    vec4 found = layer(gl_FragCoord.xy, (i == 0 ? middle : i == 1 ? near : far) * largest);
    if (found.a >= 0.0) sum += exp(found.a) * vec4(found.rgb, 1.0);
  }
  picture = sum.a > 0.0 ? vec4(clamp(sum.rgb / sum.a, 0.0, 1.0), 1.0) : vec4(0.0);
}
