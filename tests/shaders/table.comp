// What a pass makes of the section table: hits[slot] = place of the pyramid (both words), base, wide. One thread a slot.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"

layout(local_size_x_id = 0) in;

void main() {
    uint slot = gl_GlobalInvocationID.x;
    if (slot > frame.table_mask) return;
    HIT[slot] = uvec4(node_pyramid(slot), uint(node_base(slot)), node_form(slot));
}
