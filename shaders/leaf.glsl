// What a ray hits in a column: its top, or its side. A column is solid from its top down; a ray hits where it first is at or
// below the top inside the cell.
// With SMOOTH the top is a surface between four corners, bilinear; what is seen of what is solid at a jump, and at the border of
// what there is, is a side.
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

#ifdef SMOOTH
// A corner is no farther above its column's top, cells: the mean of four that rise by a jump each.
const float MOST_CORNER = 1.5 * float(JUMP_QUARTERS) / 4.0;

// Entries so little below the surface, cells, are not by a side: what rounding makes of two columns that share an edge.
const float SIDE_LEAST = 0.003;

// When the ray comes to the surface of a column (`cell`, mirrored, of `detail`) while it is there from `t` to `t_end`; FAR: it does
// not. `four`: heights of the corners that are south-west, south-east, north-west and north-east to a ray so mirrored.
// `above`: how far it comes in above it, lattice steps; `side`: it comes in below, by more than rounding.
float surface_contact(in Walk walk, Ray ray, float t, float t_end, ivec2 cell, int detail, ivec4 four, out float above, out bool side) {
    float size = float(1 << detail);
    bvec2 still = lessThan(abs(ray.step.xy), vec2(1e-20));
    vec2 speed = mix(abs(ray.step.xy), vec2(0.0), still) / size;
    vec2 borders = vec2((cell << detail) - walk.origin);
    vec2 at = mix((vec2(t) - (borders - walk.fraction) * walk.inverse) * speed, (ray.fraction.xy - borders) / size, still);
    at = clamp(at, 0.0, 1.0);
    // Height above the surface s lengths on: f0 + f1 s + f2 s².
    float east = float(four.y - four.x), north = float(four.z - four.x), twist = float(four.w - four.z) - east;
    float rise = mix(walk.z0 - float(four.x), float(ray.cell.z - four.x) + ray.fraction.z, frame.origin_step == 1.0);
    float f0 = fma(t, walk.dz, rise) - (east * at.x + north * at.y + twist * at.x * at.y);
    above = f0;
    side = f0 < -SIDE_LEAST * size * frame.cell_steps;
    if (f0 <= 0.0) return t;
    float f1 = walk.dz - (east * speed.x + north * speed.y + twist * (at.x * speed.y + at.y * speed.x));
    float f2 = -twist * speed.x * speed.y;
    float rest = t_end - t, f_end = fma(rest, fma(rest, f2, f1), f0);
    float root = f1 * f1 - 4.0 * f0 * f2, q = 0.5 * (abs(f1) + sqrt(max(root, 0.0)));
    // From above it comes on a way down, or on one that has yet to bend down.
    float s = f1 < 0.0 ? f0 / q : q / max(-f2, 1e-30);
    if (f_end <= 0.0) return t + clamp(s, 0.0, rest);
    // Through a hump and out again.
    return f1 < 0.0 && f2 > 0.0 && root >= 0.0 && s < rest ? t + s : FAR;
}

// Heights of a column's corners as they are to a ray so mirrored.
ivec4 mirrored(in Walk walk, ivec4 four) {
    if (walk.mirror.x != 0) four = four.yxwz;
    if (walk.mirror.y != 0) four = four.zwxy;
    return four;
}
#endif

// The record of a hit, as it is traced.
uvec4 record_of(Hit hit) {
    uint column = hit.column.y << SECTION_LOG2 | hit.column.x;
    uint steps = min(hit.steps, MOST_STEPS);
    return uvec4(floatBitsToUint(hit.t), hit.slot, column | hit.face << HIT_FACE_SHIFT | steps << HIT_STEPS_SHIFT, uint(hit.top));
}
