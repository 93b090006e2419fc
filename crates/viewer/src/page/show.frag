// What the canvas shows: the picture, or its depth in colours; guessed pixels marked; faded far from the photos; beside it a photo.
uniform sampler2D own, smaller, surface, photo; // `smaller`: the picture at half the size, without holes
uniform vec2 size; // of the canvas, pixels
uniform vec2 span; // disparities shown darkest and brightest, shares of the largest
uniform bool depth, guessed;
uniform float fade; // 0 to 1, of what no photo sees
uniform float wipe; // share of the width that shows the photo
uniform vec3 ground;
out vec4 shown;
// A polynomial fit of the colour map Turbo (Mikhailov, 2019; Apache 2.0).
vec3 turbo(float x) {
  vec4 a = vec4(1.0, x, x * x, x * x * x);
  vec2 b = a.zw * a.z;
  return clamp(vec3(
    dot(a, vec4(0.13572138, 4.61539260, -42.66032258, 132.13108234)) + dot(b, vec2(-152.94239396, 59.28637943)),
    dot(a, vec4(0.09140261, 2.19418839, 4.84296658, -14.18503333)) + dot(b, vec2(4.27729857, 2.82956604)),
    dot(a, vec4(0.10667330, 12.64194608, -60.58204836, 110.36276771)) + dot(b, vec2(-89.90310912, 27.34824973))), 0.0, 1.0);
}
void main() {
  vec2 at = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y) / size;
  ivec2 drawn = textureSize(own, 0), p = min(ivec2(at * vec2(drawn)), drawn - 1);
  bool exact = vec2(drawn) == size;
  vec4 found = texelFetch(own, p, 0);
  vec3 colour = found.a < 0.5 ? texture(smaller, at).rgb : exact ? found.rgb : texture(own, at).rgb;
  if (depth) {
    vec4 held = texelFetch(surface, p, 0);
    colour = turbo(clamp((unpack(held.rgb) - span.x) / max(span.y - span.x, 1e-9), 0.0, 1.0)) * (held.a > 0.9 ? 1.0 : 0.75);
  }
  if (guessed && found.a < 0.5) colour = mix(colour, vec3(1.0, 0.25, 0.6), mod(floor((gl_FragCoord.x + gl_FragCoord.y) / 4.0), 2.0) * 0.5 + 0.2);
  colour = mix(colour, ground, fade * (found.a < 0.5 ? 1.0 : 0.6));
  if (at.x < wipe) colour = texture(photo, at).rgb;
  if (wipe > 0.0 && wipe < 1.0 && abs(at.x - wipe) * size.x < 1.0) colour = vec3(1.0);
  shown = vec4(colour, 1.0);
}
