// A cell of a photo's depth on the target: window depth falls with disparity; confirmed cells lie before all others.
layout(location = 0) in vec4 cell; // left, top, side (pixels), confirmed (1 or 0)
layout(location = 1) in vec3 plane; // disparity in the middle, slopes per pixel
uniform mat3 H; // target from photo: H p + d e
uniform vec3 e;
uniform vec2 size; // of the target, pixels
uniform float largest; // disparity at which window depth is 0
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) - 0.5;
  vec2 offset = corner * cell.z;
  float d = max(plane.x + dot(plane.yz, offset), 0.0);
  vec3 p = H * vec3(cell.xy + 0.5 * cell.z + offset, 1.0) + d * e;
  float near = 1.0 - d / (p.z * largest); // 0 near, 1 far
  float depth = cell.w > 0.5 ? 0.49 * near : 0.5 + 0.49 * near;
  bool seen = p.z > 0.0 && near >= 0.0;
  gl_Position = seen ? vec4((2.0 * p.xy / size - p.z), (2.0 * depth - 1.0) * p.z, p.z) : vec4(2.0, 2.0, 2.0, 1.0);
}
