// A pixel of the window's drawing: its triangle's colour times the texture's. Reads texels.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "overlay.glsl"

layout(location = 0) in vec4 color;
layout(location = 1) in vec2 uv;
layout(location = 0) out vec4 drawn;

vec4 texel(ivec2 at) {
    at = clamp(at, ivec2(0), push.size - 1);
    return unpackUnorm4x8(push.texels.texels[at.y * push.size.x + at.x]);
}

void main() {
    vec2 at = uv * vec2(push.size);
    if (push.is_smooth == 0u) {
        drawn = color * texel(ivec2(floor(at)));
        return;
    }
    at -= 0.5;
    ivec2 low = ivec2(floor(at));
    vec2 share = at - vec2(low);
    vec4 above = mix(texel(low), texel(low + ivec2(1, 0)), share.x);
    vec4 below = mix(texel(low + ivec2(0, 1)), texel(low + ivec2(1, 1)), share.x);
    drawn = color * mix(above, below, share.y);
}
