// A photo with some of its detail (4 times a pixel less its four neighbours) added.
uniform sampler2D own;
uniform float amount;
out vec4 sharp;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy), last = textureSize(own, 0) - 1;
  vec3 colour = texelFetch(own, p, 0).rgb, detail = 4.0 * colour;
  for (int i = 0; i < 4; i++) {
    ivec2 step = ivec2(i & 1, 1 - (i & 1)) * (i < 2 ? 1 : -1);
    detail -= texelFetch(own, clamp(p + step, ivec2(0), last), 0).rgb;
  }
  sharp = vec4(clamp(colour + amount * detail, 0.0, 1.0), 1.0);
}
