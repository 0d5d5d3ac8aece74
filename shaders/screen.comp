// Packs the sum of an image's samples for the window: linear colours to sRGB bytes.
// Reads colour sums; writes a word a pixel. One thread a pixel; y is the row.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#include "passes.glsl"

layout(local_size_x = SCREEN_THREADS) in;
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer Sums { vec4 sums[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Words { uint words[]; };
layout(push_constant, scalar) uniform Push {
    Sums sums;
    Words words;
    uint width;
    float scale; // 1 / what the weights have summed up to
} push;

void main() {
    uint x = gl_GlobalInvocationID.x, y = gl_GlobalInvocationID.y;
    if (x >= push.width) return;
    uint at = y * push.width + x;
    vec3 v = clamp(push.sums.sums[at].rgb * push.scale, 0.0, 1.0);
    v = mix(v * 12.92, 1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055, greaterThan(v, vec3(0.0031308)));
    push.words.words[at] = packUnorm4x8(vec4(v, 1.0));
}
