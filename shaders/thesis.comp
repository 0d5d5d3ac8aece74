// The thesis' kernel (§3.2.3): the plain traversal over one camera section, which lies in two linear buffers: a
// pyramid of f32 heights (lattice steps from the anchor, negative infinity where nothing is), finest level first, and a
// map of RGBA8 colours. One thread a pixel, upright strips a workgroup (§3.3.2). Writes the colour, and for checks
// the hit: t, and the column's index in the colour map.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"

layout(local_size_x_id = ID_GROUP_X, local_size_y_id = ID_GROUP_Y) in;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Heights { float h[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer ColorMap { uint rgba[]; };

// Taken out of the frame's constants once. `table` is where the pyramid lies, `ramp` where the colours do,
// `table_mask` the log2 of the section's side.
uvec2 heights;
ivec2 window_low;
uint side_log2;

struct PlainNode {
    float top;
    bool there;
};

int plain_top_level() { return frame.top_level; }

PlainNode plain_node(ivec2 cell, int level) {
    uint l = uint(level), n = side_log2;
    // Where the level starts: 4^n + 4^(n-1) + ... of the finer ones.
    uint offset = (0x55555554u & ((1u << (2u * n + 1u)) - 1u)) & ~((1u << (2u * n + 2u - 2u * l)) - 1u);
    uvec2 inner = uvec2(cell - window_low) >> l;
    uint at = offset + (inner.y << (n - l)) + inner.x;
    log_load(heights, at);
    return PlainNode(Heights(heights).h[at], true);
}

uvec4 plain_hit(float t, PlainNode node, ivec2 cell, uint face) {
    uvec2 inner = uvec2(cell - window_low);
    return uvec4(floatBitsToUint(t), inner.y << side_log2 | inner.x, face, uint(int(node.top)));
}

#include "plain.glsl"

// As the thesis does it, a word a pixel; or records for checks.
layout(constant_id = ID_THESIS_SCREEN) const bool SCREEN = false;

vec3 linear_of(vec3 srgb) { return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), greaterThan(srgb, vec3(0.04045))); }

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    heights = frame.table;
    window_low = frame.low;
    side_log2 = frame.table_mask;
    uint at = pixel.y * frame.width + pixel.x;
#ifdef LOGGED
    log_begin(frame.colors, at);
#endif
    uvec4 hit = trace(ray_of(pixel));
#ifdef LOGGED
    log_end();
    return;
#endif
    uint rgba = 0u;
    if (hit.y != NO_NODE) rgba = ColorMap(frame.ramp).rgba[hit.y];
    if (SCREEN) {
        SCREEN_IMAGE[at] = rgba;
    } else {
        COLOR[at] = vec4(linear_of(unpackUnorm4x8(rgba).rgb), hit.y == NO_NODE ? 0.0 : 1.0);
        HIT[at] = hit;
    }
}
