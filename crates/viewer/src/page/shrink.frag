// Half the size: the mean of those of four pixels that hold something (alpha above 0).
uniform sampler2D own;
uniform bool packed; // whether rgb is a number of 24 bits
out vec4 mean;
void main() {
  ivec2 last = textureSize(own, 0) - 1, p = 2 * ivec2(gl_FragCoord.xy);
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; i++) {
    vec4 one = texelFetch(own, min(p + ivec2(i & 1, i >> 1), last), 0);
    if (one.a > 0.0) sum += vec4(packed ? vec3(unpack(one.rgb)) : one.rgb, 1.0);
  }
  sum.rgb /= max(sum.a, 1.0);
  mean = sum.a > 0.0 ? vec4(packed ? pack(sum.r) : sum.rgb, 1.0) : vec4(0.0);
}
