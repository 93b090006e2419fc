// Half the size: the mean of those of four pixels that hold something sure (alpha 1); where none does, of what is not (alpha 0.5).
uniform sampler2D own;
uniform bool packed; // whether rgb is a number of 24 bits
out vec4 mean;
void main() {
  ivec2 last = textureSize(own, 0) - 1, p = 2 * ivec2(gl_FragCoord.xy);
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; i++) {
    vec4 one = texelFetch(own, min(p + ivec2(i & 1, i >> 1), last), 0);
    float weight = one.a > 0.9 ? 1.0 : one.a > 0.1 ? 1e-3 : 0.0;
    sum += weight * vec4(packed ? vec3(unpack(one.rgb)) : one.rgb, 1.0);
  }
  sum.rgb /= max(sum.a, 1e-3);
  mean = vec4(packed ? pack(sum.r) : sum.rgb, sum.a > 0.9 ? 1.0 : sum.a > 0.0 ? 0.5 : 0.0);
}
