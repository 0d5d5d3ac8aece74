// Where rays meet spans of a smooth surface: what is round, and slabs. See joins.glsl.
// A tube is round where heights are not exaggerated. Its pieces, capsules, go from the middle of its column to each of its ends; of two
// ends that do not lie side by side, from one to the other. Without ends it is a ball, and where all that it
// leads to is a corner at which four meet, one about that. What is upright is one
// capsule, as wide as its column, from its bottom to its top. What of it would lie beyond its column is not there.
// Needs frame.glsl, joins.glsl.

// Radius of tubes, cells: at least, and half a pixel.
const float LEAST_RADIUS = 0.2;
const float MOST_RADIUS = 0.5;

// What is round is met on a side where it faces up or down by less.
const float LEAST_UP = 0.5;

float radius_at(Ray ray, float t, int detail) {
    float pixel = fma(t / ray.unit, frame.pixel.y, frame.pixel.x) / float(1 << detail);
    return clamp(0.5 * pixel, LEAST_RADIUS, MOST_RADIUS);
}

// A tube, in cells around the middle of its column at its own height.
struct Tube {
    uvec2 joins;
    float first, rise; // height of byte 0, and a step of it
    vec2 sign_;        // -1: the ray is mirrored
    uint ends;
    bool through;      // from one end to the other
    bool alone;        // a ball about its only end
    float up;          // half the length of its axis, where it is upright
};

vec3 end_of(Tube tube, uint k) { return vec3(0.5 * tube.sign_ * vec2(way(k)), fma(float(end_byte(tube.joins, k)), tube.rise, tube.first)); }

Tube tube_of(uvec2 joins, ivec2 ends, int detail, ivec2 mirror) {
    int slice_log2 = min(frame.slice_log2 + detail, MOST_SLICE), step_log2 = end_step(slice_log2), middle = middle_of(ends);
    float steps = frame.cell_height * float(1 << detail);
    Tube tube = Tube(joins, float(rounded(middle, step_log2, frame.height_anchor) - middle) / steps, float(1 << step_log2) / steps, vec2(1 - 2 * mirror), 0u, false, false, 0.0);
    if (is_upright(joins)) {
        tube.up = max(0.5 * float(uint(ends.x) - uint(ends.y)) / steps - MOST_RADIUS, 0.0);
        return tube;
    }
    ivec2 one = ivec2(0), other = ivec2(0);
    for (uint k = 0u; k < 8u; k++) {
        tube.alone = tube.alone || end_byte(joins, k) == -127;
        if (!has_end(joins, k)) continue;
        other = one;
        one = way(k);
        tube.ends++;
    }
    tube.through = tube.ends == 2u && one.x * other.x + one.y * other.y <= 0;
    return tube;
}

// When a ray, p + s d, comes into a capsule, FAR: it does not; `is_in`: it is in it at `start`.
float capsule_entry(vec3 p, vec3 d, vec3 a, vec3 b, float radius, float start, out bool is_in) {
    vec3 axis = b - a, from = p - a;
    float length2 = dot(axis, axis), dd = dot(d, d), along = dot(axis, d), at = dot(axis, from), first = FAR;
    float square = length2 * dd - along * along;
    if (square > 1e-6 * length2 * dd) {
        float half_b = length2 * dot(from, d) - at * along;
        float h = half_b * half_b - square * (length2 * (dot(from, from) - radius * radius) - at * at);
        if (h >= 0.0) {
            float s = -(half_b + sqrt(h)) / square, y = fma(s, along, at);
            if (y > 0.0 && y < length2) first = s;
        }
    }
    for (int end = 0; end < 2; end++) {
        vec3 off = end == 0 ? from : p - b;
        float half_b = dot(off, d), h = half_b * half_b - dd * (dot(off, off) - radius * radius);
        if (h >= 0.0) first = min(first, -(half_b + sqrt(h)) / dd);
    }
    vec3 here = fma(vec3(start), d, from);
    vec3 off = here - axis * clamp(length2 > 0.0 ? dot(here, axis) / length2 : 0.0, 0.0, 1.0);
    is_in = dot(off, off) <= radius * radius;
    return first;
}

// Way from the axis of a tube to a place.
vec3 away_from(Tube tube, vec3 place) {
    vec3 from = vec3(0.0), least = place;
    least.z -= clamp(place.z, -tube.up, tube.up);
    bool any = tube.ends == 0u;
    for (uint k = 0u; k < 8u; k++) {
        if (!has_end(tube.joins, k)) continue;
        vec3 end = end_of(tube, k);
        if (tube.through && from == vec3(0.0)) {
            from = end;
            continue;
        }
        if (tube.alone) return place - end;
        vec3 axis = end - from, off = place - from;
        off -= axis * clamp(dot(off, axis) / dot(axis, axis), 0.0, 1.0);
        if (!any || dot(off, off) < dot(least, least)) least = off;
        any = true;
    }
    return least;
}

#ifdef WALKED
// When the ray comes to a tube while it is in a column (`cell`, mirrored, of `detail`) from `t` to `t_end`; FAR: it does not. `face`:
// of the border that it comes in by; then what it meets.
float tube_contact(in Walk walk, Ray ray, float t, float t_end, ivec2 cell, int detail, ivec2 ends, uvec2 joins, inout uint face) {
    Tube tube = tube_of(joins, ends, detail, walk.mirror);
    float size = float(1 << detail), steps = frame.cell_height * size;
    int middle = middle_of(ends);
    bvec2 still = lessThan(abs(ray.step.xy), vec2(1e-20));
    vec2 speed = mix(abs(ray.step.xy), vec2(0.0), still) / size;
    vec2 borders = vec2((cell << detail) - walk.origin);
    vec2 at = mix((vec2(t) - (borders - walk.fraction) * walk.inverse) * speed, (ray.fraction.xy - borders) / size, still);
    float rise = mix(walk.z0 - float(middle), float(ray.cell.z - middle) + ray.fraction.z, frame.origin_step == 1.0);
    vec3 d = vec3(speed, walk.dz / steps), p = vec3(at - 0.5, fma(t, walk.dz, rise) / steps);
    // From where it is nearest to the middle, or, of what is upright, to its axis.
    vec3 across = is_upright(joins) && dot(d.xy, d.xy) > 0.0 ? vec3(d.xy, 0.0) : d;
    float on = -dot(p, across) / dot(across, across), radius = is_upright(joins) ? MOST_RADIUS : radius_at(ray, t, detail), first = FAR;
    if (is_upright(joins)) on = clamp(on, 0.0, t_end - t);
    p = vec3(fma(vec2(on), d.xy, p.xy), fma(t + on, walk.dz, rise) / steps);
    // Ends are no farther away.
    if (tube.up == 0.0 && dot(p, p) > 8.0) return FAR;
    vec3 from = vec3(0.0);
    bool is_in = false, in_one;
    if (tube.ends == 0u) first = capsule_entry(p, d, vec3(0.0, 0.0, -tube.up), vec3(0.0, 0.0, tube.up), radius, -on, is_in);
    for (uint k = 0u; k < 8u && tube.ends != 0u; k++) {
        if (!has_end(joins, k)) continue;
        vec3 end = end_of(tube, k);
        if (tube.through && from == vec3(0.0)) {
            from = end;
            continue;
        }
        float s = capsule_entry(p, d, tube.alone ? end : from, end, radius, -on, in_one);
        is_in = is_in || in_one;
        // Behind where it comes into the column.
        if (s >= -on) first = min(first, s);
    }
    if (is_in) return t;
    first += t + on;
    if (!(first >= t && first <= t_end)) return FAR;
    vec3 normal = normalize(away_from(tube, fma(vec3(first - t - on), d, p)));
    if (abs(normal.z) >= LEAST_UP) face = normal.z > 0.0 ? FACE_TOP : FACE_BOTTOM;
    else if (abs(normal.x) > abs(normal.y)) face = normal.x < 0.0 ? FACE_WEST : FACE_EAST;
    else face = normal.y < 0.0 ? FACE_SOUTH : FACE_NORTH;
    return first;
}

// The same of a slab, between two surfaces.
float slab_contact(in Walk walk, Ray ray, float t, float t_end, ivec2 cell, int detail, ivec2 ends, uvec2 joins, inout uint face) {
    int slice_log2 = min(frame.slice_log2 + detail, MOST_SLICE);
    ivec4 tops = span_corners(joins.x, ends.x, slice_log2, frame.height_anchor), bottoms = span_corners(joins.y, ends.y, slice_log2, frame.height_anchor);
    bool is_below, is_above;
    float above, below;
    float t_top = surface_contact(walk, ray, t, t_end, cell, detail, mirrored(walk, tops), above, is_below);
    if (above > 0.0) {
        face = FACE_TOP;
        return t_top;
    }
    // Upside down.
    walk.z0 = -walk.z0;
    walk.dz = -walk.dz;
    ray.cell.z = -ray.cell.z;
    ray.fraction.z = -ray.fraction.z;
    float t_bottom = surface_contact(walk, ray, t, t_end, cell, detail, mirrored(walk, -bottoms), below, is_above);
    if (below > 0.0) {
        face = FACE_BOTTOM;
        return t_bottom;
    }
    if (!is_below) face = FACE_TOP;
    else if (!is_above) face = FACE_BOTTOM;
    return t;
}

// What is known of a span besides its ends.
struct Joined {
    uint class_;
    uvec2 words;
    bool slab;
};

// Of the one whose first word is `at`.
Joined joined_at(Section section, uint at, uint joins) {
    uint class_ = pool_load(section.pyramid, at + 1u + wide_of(section.form)) >> SHOWN_CLASS_SHIFT;
    uvec2 words = joins_at(section.pyramid, at + joins);
    return Joined(class_, words, !is_upright(words) && !is_tube(words));
}

// The same of any span.
float joined_contact(in Walk walk, Ray ray, float t, float t_end, ivec2 cell, int detail, Joined joined, ivec2 ends, inout uint face) {
    float z = fma(t, walk.dz, walk.z0), z_end = fma(t_end, walk.dz, walk.z0), beyond = MOST_CORNER * frame.cell_height * float(1 << detail);
    if (max(z, z_end) < float(ends.y) - beyond || min(z, z_end) > float(ends.x) + beyond) return FAR;
    if (!joined.slab) return tube_contact(walk, ray, t, t_end, cell, detail, ends, joined.words, face);
    return slab_contact(walk, ray, t, t_end, cell, detail, ends, joined.words, face);
}
#endif
