#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
// A number from 0 to 1 as three digits of base 255, and back.
vec3 pack(float value) {
  vec3 digits = fract(vec3(1.0, 255.0, 65025.0) * clamp(value, 0.0, 0.9999999));
  return digits - digits.yzz * vec3(1.0 / 255.0, 1.0 / 255.0, 0.0);
}
float unpack(vec3 digits) { return dot(digits, vec3(1.0, 1.0 / 255.0, 1.0 / 65025.0)); }
