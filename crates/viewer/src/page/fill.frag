// A picture whose holes (alpha up to `least`) are taken from a smaller one without holes, between its pixels; alpha stays.
uniform sampler2D own, smaller;
uniform bool packed; // whether rgb is a number of 24 bits
uniform float least;
out vec4 filled;
void main() {
  filled = texelFetch(own, ivec2(gl_FragCoord.xy), 0);
  if (filled.a > least) return;
  ivec2 last = textureSize(smaller, 0) - 1;
  vec2 at = 0.5 * gl_FragCoord.xy - 0.5;
  ivec2 p = ivec2(floor(at));
  vec2 share = at - floor(at);
  vec3 sum = vec3(0.0);
  for (int i = 0; i < 4; i++) {
    ivec2 step = ivec2(i & 1, i >> 1);
    vec3 one = texelFetch(smaller, clamp(p + step, ivec2(0), last), 0).rgb;
    vec2 weight = mix(1.0 - share, share, vec2(step));
    sum += weight.x * weight.y * (packed ? vec3(unpack(one)) : one);
  }
  filled.rgb = packed ? pack(sum.r) : sum;
}
