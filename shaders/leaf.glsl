// What a ray hits in a column: its top, or its side. A column is solid from its top down; a ray hits where it first is at or
// below the top inside the cell.
// Needs frame.glsl.

// A ray that is walked, mirrored so that it goes east and north.
struct Walk {
    ivec2 mirror;   // 1 where the ray goes west / south
    ivec2 origin;   // cell of the origin, mirrored
    vec2 fraction;  // and where in it
    vec2 inverse;   // lengths in one cell
    float z0, dz;   // lattice steps
};

// How long it stays in a column: t from and to, and the face that it came in by, mirrored.
struct Stay {
    float t, t_end;
    uint face;
};

// What a ray found: see the hit record in frame.glsl.
struct Hit {
    float t;
    uint slot; // NO_NODE: nothing
    uvec2 column;
    uint face;
    int top;
    uint steps; // nodes looked at
};

// The hit of `ray` in the column that `found` names, where it is at or below the top at the latest as it leaves.
Hit hit_in(in Walk walk, Ray ray, Stay stay, Hit found) {
    if (fma(stay.t, walk.dz, walk.z0) > float(found.top)) {
        found.face = FACE_TOP;
        // No branch: drivers recompile for constants that one follows from.
        float rise = mix(float(found.top) - walk.z0, float(found.top - ray.cell.z) - ray.fraction.z, frame.origin_step == 1.0);
        found.t = clamp(rise / walk.dz, stay.t, stay.t_end);
    }
    if (found.face == FACE_WEST || found.face == FACE_SOUTH)
        found.face += uint(found.face == FACE_WEST ? walk.mirror.x : walk.mirror.y);
    return found;
}

// The record of a hit, as it is traced.
uvec4 record_of(Hit hit) {
    uint column = hit.column.y << SECTION_LOG2 | hit.column.x;
    uint steps = min(hit.steps, MOST_STEPS);
    return uvec4(floatBitsToUint(hit.t), hit.slot, column | hit.face << HIT_FACE_SHIFT | steps << HIT_STEPS_SHIFT, uint(hit.top));
}
