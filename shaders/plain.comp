// The plain traversal over the pool, section by section: it knows nothing of what lies above a section's
// coarsest level. Writes the same hit records as trace.comp.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"

layout(local_size_x_id = ID_GROUP_X, local_size_y_id = ID_GROUP_Y) in;

struct PlainNode {
    int top;
    bool there;
    uint slot;
    uvec2 inner; // node index in its section
};

int plain_top_level() { return int(SECTION_LOG2); }

PlainNode plain_node(ivec2 cell, int level) {
    PlainNode node;
    node.slot = find_node(SECTION_LOG2, cell >> int(SECTION_LOG2));
    node.inner = uvec2(cell >> level) & ((SECTION_SIDE >> level) - 1u);
    node.top = 0;
    node.there = false;
    if (node.slot != NO_NODE) {
        uint code = pyramid_code(node_pyramid(node.slot), uint(level), node.inner, node_form(node.slot));
        node.top = node_base(node.slot) + int(code);
        node.there = code != 0u;
    }
    return node;
}

uvec4 plain_hit(float t, PlainNode node, ivec2 cell, uint face) {
    return uvec4(floatBitsToUint(t), node.slot, node.inner.y << SECTION_LOG2 | node.inner.x | face << HIT_FACE_SHIFT, uint(node.top));
}

#include "plain.glsl"

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    uint at = pixel.y * frame.width + pixel.x;
#ifdef LOGGED
    log_begin(frame.colors, at);
#endif
    HIT[at] = trace(ray_of(pixel));
#ifdef LOGGED
    log_end();
#endif
}
