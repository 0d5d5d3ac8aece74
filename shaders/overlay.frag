// A pixel of the window's drawing: its triangle's colour times the texture's. Reads texels.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "overlay.glsl"

layout(location = 0) in vec4 color;
layout(location = 1) in vec2 uv;
layout(location = 0) out vec4 drawn;

// The image encodes what is written.
layout(constant_id = 0) const bool LINEAR = false;

vec4 texel(ivec2 at) {
    at = clamp(at, ivec2(0), push.size - 1);
    return unpackUnorm4x8(push.texels.texels[at.y * push.size.x + at.x]);
}

vec3 linear_of(vec3 srgb) { return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), greaterThan(srgb, vec3(0.04045))); }

// The same colour where the image encodes: blended there, what is half transparent comes out a little lighter.
vec4 written(vec4 encoded) {
    if (!LINEAR || encoded.a == 0.0) return encoded;
    return vec4(linear_of(min(encoded.rgb / encoded.a, 1.0)) * encoded.a, encoded.a);
}

void main() {
    vec2 at = uv * vec2(push.size);
    if (push.is_smooth == 0u) {
        drawn = written(color * texel(ivec2(floor(at))));
        return;
    }
    at -= 0.5;
    ivec2 low = ivec2(floor(at));
    vec2 share = at - vec2(low);
    vec4 above = mix(texel(low), texel(low + ivec2(1, 0)), share.x);
    vec4 below = mix(texel(low + ivec2(0, 1)), texel(low + ivec2(1, 1)), share.x);
    drawn = written(color * mix(above, below, share.y));
}
