// What a ray hits in a column: its top, or its side. A column is solid from its top down; a ray hits where it first is at or
// below the top inside the cell.
// Needs pool.glsl, section.glsl, frame.glsl, lookup.glsl, walk.glsl.

// What a ray found: see the hit record in frame.glsl.
struct Hit {
    float t;
    uint slot; // NO_NODE: nothing
    uvec2 column;
    uint face;
    int top;
    uint steps; // nodes looked at
};

// Nothing, after so many steps.
Hit no_hit(uint steps) { return Hit(0.0, NO_NODE, uvec2(0), 0u, 0, steps); }

// Whether the column that the walk has come to is in the window: what it does not hold is not there, and the ray has left
// it, then.
bool is_in_window(in Walk walk) {
    ivec2 cell = walk.node << walk.level;
    return !any(lessThan(cell, walk.low)) && !any(greaterThanEqual(cell, walk.high));
}

// The hit of `ray` in the column of height `top` that its walk has come to, of the section in `slot`.
Hit hit_in(in Walk walk, Ray ray, uint slot, int detail, int top) {
    float t = walk.t;
    uint face = walk.face;
    if (fma(t, walk.dz, walk.z0) > float(top)) {
        face = FACE_TOP;
        // No branch: drivers recompile for constants that one follows from.
        float rise = mix(float(top) - walk.z0, float(top - ray.cell.z) - ray.fraction.z, frame.origin_step == 1.0);
        t = clamp(rise / walk.dz, t, walk.t_exit);
    }
    if (face == FACE_WEST || face == FACE_SOUTH) face += uint(face == FACE_WEST ? walk.mirror.x : walk.mirror.y);
    uvec2 column = uvec2(real_node(walk) >> detail - walk.level) & (SECTION_SIDE - 1u);
    return Hit(t, slot, column, face, top, walk.steps);
}

// The record of a hit, as it is traced.
uvec4 record_of(Hit hit) {
    uint column = hit.column.y << SECTION_LOG2 | hit.column.x;
    uint steps = min(hit.steps, MOST_STEPS);
    return uvec4(floatBitsToUint(hit.t), hit.slot, column | hit.face << HIT_FACE_SHIFT | steps << HIT_STEPS_SHIFT, uint(hit.top));
}
