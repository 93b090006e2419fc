// A photo's depth on the target, a square for each pixel, or for one of each `stride` × `stride`: as in crates/surface/src/fusion.rs, a fifth of a
// pixel larger on each side. Window depth falls with disparity; confirmed depth lies before all other.
uniform usampler2D code;
uniform int stride;
uniform mat3 H; // target from photo: H p + d e
uniform vec3 e;
uniform vec2 size; // of the target, pixels
uniform float unit; // disparity of a step of the code
uniform float focal; // focal length of the target, of the photo's
uniform float largest; // disparity at which window depth is 0
void main() {
  int across = textureSize(code, 0).x / stride;
  ivec2 at = stride * ivec2(gl_VertexID % across, gl_VertexID / across) + stride / 2;
  uint found = texelFetch(code, at, 0).r;
  float d = (float(found & 0x7fffu) - 1.0) * unit;
  vec3 p = H * vec3(vec2(at) + 0.5, 1.0) + d * e;
  float near = 1.0 - d / (p.z * largest); // 0 near, 1 far
  float depth = found > 0x8000u ? 0.49 * near : 0.5 + 0.49 * near;
  bool seen = d >= 0.0 && p.z > 0.0 && near >= 0.0;
  gl_Position = seen ? vec4((2.0 * p.xy / size - p.z), (2.0 * depth - 1.0) * p.z, p.z) : vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = float(stride) * focal / p.z + 0.4;
}
