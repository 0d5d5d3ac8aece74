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
    uint steps; // nodes looked at; where things float, which span of its block, from 1 on, 0: the solid part
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

#ifdef STACKED
// t at which the ray comes to `height`, lattice steps from the anchor, on its way through a column.
float t_of(in Walk walk, Ray ray, float t, float t_end, int height) {
    float rise = mix(float(height) - walk.z0, float(height - ray.cell.z) - ray.fraction.z, frame.origin_step == 1.0);
    return clamp(rise / walk.dz, t, t_end);
}

// When the ray comes to a span of a column, from `bottom` to `top`, heights included; FAR: it does not.
float contact(in Walk walk, Ray ray, float t, float t_end, int bottom, int top) {
    float z = fma(t, walk.dz, walk.z0), z_end = fma(t_end, walk.dz, walk.z0);
    if (z > float(top)) return z_end <= float(top) ? t_of(walk, ray, t, t_end, top) : FAR;
    if (z < float(bottom)) return z_end >= float(bottom) ? t_of(walk, ray, t, t_end, bottom) : FAR;
    return t;
}

// As `hit_in`, of a span.
Hit span_hit_in(in Walk walk, Ray ray, Stay stay, Hit found, int bottom) {
    float z = fma(stay.t, walk.dz, walk.z0);
    if (z > float(found.top)) {
        found.face = FACE_TOP;
        found.t = t_of(walk, ray, stay.t, stay.t_end, found.top);
    } else if (z < float(bottom)) {
        found.face = FACE_BOTTOM;
        found.t = t_of(walk, ray, stay.t, stay.t_end, bottom);
    }
    if (found.face == FACE_WEST || found.face == FACE_SOUTH)
        found.face += uint(found.face == FACE_WEST ? walk.mirror.x : walk.mirror.y);
    return found;
}
#endif

// The record of a hit, as it is traced.
uvec4 record_of(Hit hit) {
    uint column = hit.column.y << SECTION_LOG2 | hit.column.x;
    uint steps = min(hit.steps, MOST_STEPS);
    return uvec4(floatBitsToUint(hit.t), hit.slot, column | hit.face << HIT_FACE_SHIFT | steps << HIT_STEPS_SHIFT, uint(hit.top));
}
