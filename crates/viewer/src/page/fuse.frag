// The photos' depths fused on the target, as in crates/surface/src/fusion.rs: of the confirmed ones the nearest that another photo has too, else
// the nearest; with it the mean of those just behind. Where none is confirmed, the same of the others.
// Disparity as 24 bits of its share of `largest`; alpha: 1 confirmed, 0.5 not, 0 no depth.
uniform sampler2D depths[6];
uniform int count;
uniform float same, averaged; // shares of `largest`
out vec4 fused;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  float z[6] = float[6](texelFetch(depths[0], p, 0).r, 1.0, 1.0, 1.0, 1.0, 1.0);
  if (count > 1) z[1] = texelFetch(depths[1], p, 0).r;
  if (count > 2) z[2] = texelFetch(depths[2], p, 0).r;
  if (count > 3) z[3] = texelFetch(depths[3], p, 0).r;
  if (count > 4) z[4] = texelFetch(depths[4], p, 0).r;
  if (count > 5) z[5] = texelFetch(depths[5], p, 0).r;
  bool sure = false;
  for (int i = 0; i < 6; i++) sure = sure || z[i] < 0.495;
  float d[6];
  float nearest = -1.0, paired = -1.0;
  for (int i = 0; i < 6; i++) {
    float share = sure ? 1.0 - z[i] / 0.49 : 1.0 - (z[i] - 0.5) / 0.49;
    d[i] = sure == (z[i] < 0.495) && z[i] < 0.995 ? max(share, 0.0) : -1.0;
    nearest = max(nearest, d[i]);
    for (int j = 0; j < i; j++) {
      if (min(d[i], d[j]) >= 0.0 && abs(d[i] - d[j]) <= same) paired = max(paired, max(d[i], d[j]));
    }
  }
  if (nearest < 0.0) {
    fused = vec4(0.0);
    return;
  }
  float front = paired >= 0.0 ? paired : nearest;
  float sum = 0.0, number = 0.0;
  for (int i = 0; i < 6; i++) {
    bool counts = d[i] >= 0.0 && d[i] <= front && front - d[i] <= averaged;
    sum += counts ? d[i] : 0.0;
    number += counts ? 1.0 : 0.0;
  }
  fused = vec4(pack(sum / number), sure ? 1.0 : 0.5);
}
