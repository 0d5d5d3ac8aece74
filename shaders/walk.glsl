// The walk of one ray through nodes: the quadtree of sections (the table), and a section's maximum pyramid down to its
// columns.
//
// The ray is mirrored so that it goes east and north. Its place is the node it is in (index and level) and t. A
// node's far border gives t directly from the ray's origin (never step by step), so no error builds up; where in a
// node the ray is, is asked only on the way down, and answered by the t of the middle border. So large steps lead
// where small ones do, and a node is passed over exactly when all its columns would be: t and z(t) round
// monotonically. Cells are half-open: a corner belongs to the cell north-east of it.
//
// The loops are one function on purpose (docs/performance.md): taken apart they took longer, and lavapipe (Mesa 22.3) and
// SwiftShader lost hits, it seems where a value of a thread that had left a loop was still computed for it.
// With STACKED, spans that float are looked for, too.
// With SMOOTH, too, the surface of what is solid is looked for in each column, whose height alone is no bound.
// Needs pool.glsl, section.glsl, frame.glsl, lookup.glsl, leaf.glsl; STACKED: floats.glsl; SMOOTH: corners.glsl, joins.glsl, tubes.glsl.

// Inverse of a step that is none.
const float STILL = 1e30;
// Level that no walk starts at: where it started is behind it.
const int STARTED = 64;

// t at which the ray crosses `border` (a finest cell border, mirrored) of each axis; beyond FAR where it runs along.
vec2 t_at(in Walk walk, ivec2 border) { return (vec2(border - walk.origin) - walk.fraction) * walk.inverse; }

// Which of `borders` the ray is past at t. At a corner an eastward step comes first, a westward one last.
ivec2 past(in Walk walk, ivec2 borders, float t) {
    vec2 ts = t_at(walk, borders);
    return walk.mirror.x == 0 ? ivec2(ts.x <= t, ts.y < t) : ivec2(ts.x < t, ts.y <= t);
}

// Levels that a walk can go up where it crossed `border` (nodes of its level); border 0 is one of all levels.
int ups(int border) { return findLSB(border | 1 << 30); }

// Whether a ray goes no way along an axis. -0 and what is nearly 0 go east and north, and never arrive.
bvec2 is_still(Ray ray) { return lessThan(abs(ray.step.xy), vec2(1e-20)); }

Walk walk_of(Ray ray) {
    Walk walk;
    bvec2 still = is_still(ray);
    walk.mirror = ivec2(lessThan(ray.step.xy, vec2(0.0))) * ivec2(not(still));
    walk.inverse = mix(abs(1.0 / ray.step.xy), vec2(STILL), still);
    walk.origin = ray.cell.xy ^ -walk.mirror;
    walk.fraction = mix(ray.fraction.xy, 1.0 - ray.fraction.xy, equal(walk.mirror, ivec2(1)));
    // Where a ray runs along an axis it stays in its cell, on a border or not: it was always, or is never, between two
    // others.
    walk.fraction = mix(walk.fraction, vec2(0.5), still);
    walk.z0 = origin_height(ray);
    walk.dz = ray.step.z;
    return walk;
}

// How a ray comes to what there is.
struct Entry {
    ivec2 low, high;  // what there is, mirrored
    float t, t_leave; // t from and to
    uint face;        // of the border that it comes through, mirrored; or none
    ivec2 cell;       // finest cell that it is in then
};

// From t `start` on, where the ray is known to be above everything.
Entry entry_of(in Walk walk, Ray ray, float start) {
    Entry entry;
    entry.low = mix(frame.low, -frame.high, equal(walk.mirror, ivec2(1)));
    entry.high = mix(frame.high, -frame.low, equal(walk.mirror, ivec2(1)));
    // On to the border of what there is.
    vec2 enter = t_at(walk, entry.low), leave = t_at(walk, entry.high);
    entry.t = start;
    entry.face = start == ray.start ? FACE_INSIDE : FACE_TOP;
    // A ray that stands over one cell leaves it beyond everything.
    float t_enter = max(enter.x, enter.y);
    entry.t_leave = min(min(leave.x, leave.y), FAR);
    if (t_enter > entry.t) {
        entry.t = t_enter;
        entry.face = enter.x >= enter.y ? FACE_WEST : FACE_SOUTH;
    }
    // Rounding may put it a border off.
    vec2 at = fma(vec2(entry.t), mix(abs(ray.step.xy), vec2(0.0), is_still(ray)), walk.fraction);
    ivec2 cell = clamp(walk.origin + ivec2(floor(at)), entry.low, entry.high - 1);
    ivec2 ahead = past(walk, cell + 1, entry.t), behind = 1 - past(walk, cell, entry.t);
    entry.cell = clamp(cell + ahead - behind * (1 - ahead), entry.low, entry.high - 1);
    return entry;
}

// Traces `ray` from t `start` on, where it is known to be above everything, beginning at `level`.
Hit trace(Ray ray, float start, int level) {
    Hit hit = Hit(0.0, NO_NODE, uvec2(0), 0u, 0, 0u);
    Walk walk = walk_of(ray);
    Entry entry = entry_of(walk, ray, start);
    if (entry.t >= entry.t_leave) return hit;
    ivec2 low = entry.low, high = entry.high, cell = entry.cell;
    float t = entry.t, t_leave = entry.t_leave;
    uint face = entry.face;

    int first = min(level, frame.top_level);
    level = max(first, frame.section_level);
    ivec2 node = cell >> level;
    ivec2 flip = -walk.mirror;
    // Whether a stay of no length in a node counts: not where the ray only touches a corner on the way from the
    // south-west to the north-east or back.
    bool diagonal = walk.mirror.x == walk.mirror.y;
    bool touches = !diagonal || face == FACE_INSIDE;
    bool falls = walk.dz < 0.0;
    bool done = false;

    while (!done) {
        // Through the table to a section that may be hit.
        float t_exit;
        bool east;
        while (true) {
            hit.steps++;
            log_step();
            vec2 ts = t_at(walk, node + 1 << level);
            east = walk.mirror.x == 0 ? ts.x <= ts.y : ts.x < ts.y;
            t_exit = max(east ? ts.x : ts.y, t);
            hit.slot = find_node(uint(level), node ^ flip);
            uint top = hit.slot != NO_NODE ? node_top(hit.slot) : 0u;
            // A ray that starts below the table's levels is near something.
            bool down = hit.slot != NO_NODE && (fma(falls ? t_exit : t, walk.dz, walk.z0) <= uintBitsToFloat(top) || first < level);
            if (down && is_section(top)) break;
            if (down) {
                level--;
                node = node * 2 + past(walk, (node * 2 + 1) << level, t);
            } else {
                done = !(t_exit < t_leave);
                if (done) break;
                first = STARTED;
                t = t_exit;
                node += ivec2(east, !east);
                face = east ? FACE_WEST : FACE_SOUTH;
                touches = !diagonal;
                // Up where a 2x2 square of nodes ends, and as far as a section may reach that begins here.
                int crossed = east ? node.x : node.y;
                int up = min(max(~crossed & 1, min(ups(crossed), frame.section_level - level)), frame.top_level - level);
                level += up;
                node >>= up;
            }
        }
        if (done) break;

        // A node of a section that reaches farther ends where the node does, and may be smaller than its cells.
        int ceiling = level, detail = detail_of(hit.slot), finest = min(detail, level - 1);
        if (first < ceiling) {
            level = max(first, finest);
            node = cell >> level;
            first = STARTED;
        } else {
            level--;
            node = node * 2 + past(walk, (node * 2 + 1) << level, t);
        }
        int top = 0;
        float t_end = 0.0;
        bool found = false;
#ifdef STACKED
        uint span = 0u;
        int bottom = 0;
#endif
#ifdef SMOOTH
        bool side = false;
        uint span_face = 0u;
        Joined met = Joined(0u, uvec2(0u), false);
#endif
        // From section to section, as long as they are of one size.
        while (true) {
        Section section = section_in(hit.slot, detail);
#ifdef SMOOTH
        uint corners = node_corners(hit.slot), joins = node_joins(hit.slot);
        // What is smooth leads so far beyond its column's codes, lattice steps.
        float beyond = MOST_CORNER * frame.cell_height * float(1 << detail);
#endif
#ifdef STACKED
        uint floats = node_floats(hit.slot), form = section.form, step_log2 = max(floats, 1u) - 1u, last_in_block = 1u + floats_of(form);
        // As in `pyramid_code`, once a section. Words of wide codes do not tell what floats: all columns are looked at.
        bool is_wide = wide_of(form) != 0u, all_looked_at = floats != 0u && is_wide;
        uint words = block_words(form), above_blocks = upper_levels(form), code_bits = is_wide ? 0xFFFFFFFFu : MOST_NARROW_CODE;
        uint halves_above = 1u - wide_of(form), halves_in_block = floats_of(form) != 0u ? 0u : halves_above;
        uint below_bits = floats != 0u && !is_wide ? ~MOST_NARROW_CODE : 0u;
        // A column that is to be looked at for what floats in it is left to the end of this loop, so that steps stay short: then it is
        // hit, or passed.
        while (true) {
        bool look = false;
        int highest_here = 0;
#endif
        while (true) {
            hit.steps++;
            log_step();
            vec2 ts = t_at(walk, node + 1 << level);
            east = walk.mirror.x == 0 ? ts.x <= ts.y : ts.x < ts.y;
            t_exit = max(east ? ts.x : ts.y, t);
#ifndef STACKED
            uint code = code_at(section, level, node ^ flip);
            int highest = height_of(section, code);
            bool down = code != 0u && fma(falls ? t_exit : t, walk.dz, walk.z0) <= float(highest) && (t_exit > t || touches);
#else
            float z = fma(t, walk.dz, walk.z0), z_exit = fma(t_exit, walk.dz, walk.z0);
            float least_z = min(z, z_exit), most_z = max(z, z_exit);
            // Of a node of levels 0 to 2 where something floats its word says what is solid, too, and how low what floats begins.
            uint l = uint(max(level - detail, 0));
            bool is_in_block = l <= last_in_block;
            uint log2_side = (is_in_block ? DERIVED_BLOCK_LOG2 : SECTION_LOG2) - l, halves = is_in_block ? halves_in_block : halves_above;
            uvec2 inner = uvec2((node ^ flip) >> max(detail - level, 0)) & (SECTION_SIDE >> l) - 1u;
            uvec2 block = inner >> log2_side, in_it = inner & (1u << log2_side) - 1u;
            uint first = is_in_block ? (block.y << DERIVED_BLOCKS_LOG2 | block.x) * words : above_blocks;
            uint nth = (is_in_block ? before_in_block(l) : upper_level(l)) + (in_it.y << log2_side | in_it.x);
            uint word = pool_load(section.pyramid, first + (nth >> halves)), code = word >> (nth & halves) * 16u & code_bits;
            int highest = height_of(section, code);
            uvec2 how_low = below_code(is_in_block ? word & below_bits : 0u);
            bool some_float = how_low.y != 0u || is_in_block && all_looked_at;
            float solid = float(highest - int(how_low.x << step_log2));
            float lowest = how_low.y != STACK_MOST_BELOW ? float(highest - int(how_low.y << step_log2)) : -STILL;
#ifdef SMOOTH
            float above = l == 0u && corners != 0u ? beyond : 0.0;
            some_float = some_float || corners != 0u;
            bool in_node = least_z <= float(highest) + above && (least_z <= solid + above || most_z >= lowest - beyond);
#else
            bool in_node = least_z <= float(highest) && (least_z <= solid || most_z >= lowest);
#endif
            bool down = code != 0u && in_node && (t_exit > t || touches);
            if (down && level == finest && some_float) {
                look = true;
                highest_here = highest;
                break;
            }
#endif
            if (down && level == finest) {
                found = true;
                top = highest;
                t_end = t_exit;
                break;
            }
            if (down) {
                level--;
                node = node * 2 + past(walk, (node * 2 + 1) << level, t);
            } else {
                done = !(t_exit < t_leave);
                t = t_exit;
                node += ivec2(east, !east);
                face = east ? FACE_WEST : FACE_SOUTH;
                touches = !diagonal;
                int crossed = east ? node.x : node.y;
                if (done || (crossed & (1 << ceiling - level) - 1) == 0) break;
                int up = ~crossed & 1;
                level += up;
                node >>= up;
            }
        }
#ifdef STACKED
        if (!look) break;
        uvec2 inner = uvec2((node ^ flip) >> detail - level) & SECTION_SIDE - 1u;
        float z = fma(t, walk.dz, walk.z0), z_exit = fma(t_exit, walk.dz, walk.z0);
        bool is_solid = true;
        uint block = block_of(inner), list = 0u;
        if (floats != 0u) list = list_of(section.pyramid, block);
        if (list != 0u) {
            uint code = code_in(section.pyramid, list, OF_SOLID, in_block(inner), form);
            highest_here = height_of(section, code);
            is_solid = code != 0u && min(z, z_exit) <= float(highest_here);
        }
        // The first contact, of several at once that of the larger record, which comes first.
        float first_contact = !is_solid ? FAR : z <= float(highest_here) ? t : t_of(walk, ray, t, t_exit, highest_here);
#ifdef SMOOTH
        if (corners != 0u) {
            uvec4 codes = corners_of(section.pyramid, corners, inner, wide_of(form));
            first_contact = FAR;
            ivec4 four = mirrored(walk, section.base + ivec4(codes));
            float above;
            if (codes.x != 0u) first_contact = surface_contact(walk, ray, t, t_exit, node >> detail - level, detail, four, above, side);
        }
#endif
        uvec2 spans = uvec2(0u);
        if (list != 0u) spans = spans_of_column(section.pyramid, list, in_block(inner));
        uint from = 0u;
        if (spans.y != 0u) from = spans_of(section.pyramid, block);
        for (uint k = 0u; k < spans.y; k++) {
            uint span_at = from + (spans.x + k) * span_words(form);
            uvec2 one = two_codes(section.pyramid, span_at, form);
            int span_top = height_of(section, one.x), span_bottom = height_of(section, one.y);
#ifdef SMOOTH
            uint face_here = face;
            Joined joined = Joined(0u, uvec2(0u), false);
            float t_contact;
            if (joins == 0u) t_contact = contact(walk, ray, t, t_exit, span_bottom, span_top);
            else {
                joined = joined_at(section, span_at, joins);
                if (is_joined_above(joined.words)) {
                    // What is met of the whole shows as this.
                    if (span != 0u && joined.class_ == met.class_ && (met.slab || is_upright(met.words)) && fma(first_contact, walk.dz, walk.z0) <= float(span_top)) {
                        span = spans.x + k + 1u;
                        highest_here = span_top;
                    }
                    continue;
                }
                t_contact = joined_contact(walk, ray, t, t_exit, node >> detail - level, detail, joined, ivec2(span_top, span_bottom), face_here);
            }
#else
            // The highest come first.
            if (min(z, z_exit) > float(span_top) || falls && span != 0u) break;
            float t_contact = contact(walk, ray, t, t_exit, span_bottom, span_top);
#endif
            if (t_contact < first_contact || t_contact == first_contact && t_contact != FAR && span == 0u) {
                first_contact = t_contact;
                span = spans.x + k + 1u;
                bottom = span_bottom;
#ifdef SMOOTH
                span_face = face_here;
                met = joined;
#endif
                highest_here = span_top;
            }
        }
        if (first_contact != FAR) {
            found = true;
            top = highest_here;
            t_end = t_exit;
#ifdef SMOOTH
            if (span == 0u ? corners != 0u : joins != 0u) t_end = first_contact;
#endif
            break;
        }
        // On, as above.
        done = !(t_exit < t_leave);
        t = t_exit;
        node += ivec2(east, !east);
        face = east ? FACE_WEST : FACE_SOUTH;
        touches = !diagonal;
        int crossed = east ? node.x : node.y;
        if (done || (crossed & (1 << ceiling - level) - 1) == 0) break;
        int up = ~crossed & 1;
        level += up;
        node >>= up;
        }
#endif
        if (found || done) break;
        // The level stays as it is: what is near the ray here is near it there. What has climbed to the section's
        // own size goes on in the table, which skips more.
        if (level == ceiling - 1) break;
        uint next = node_beside(hit.slot, uint(face == FACE_WEST ? walk.mirror.x : 2 + walk.mirror.y));
        if (next == NO_NODE) break;
        hit.slot = next;
        level++;
        node >>= 1;
        }
        if (found) {
            // What the window does not hold is not there; the ray has left it, then.
            done = true;
            if (any(lessThan(node << level, low)) || any(greaterThanEqual(node << level, high))) break;
            uvec2 column = uvec2((node ^ flip) >> detail - finest) & (SECTION_SIDE - 1u);
#ifdef STACKED
#ifdef SMOOTH
            if (span != 0u && node_joins(hit.slot) != 0u) {
                if (walk.mirror.x != 0 && (span_face == FACE_WEST || span_face == FACE_EAST)) span_face = FACE_WEST + FACE_EAST - span_face;
                if (walk.mirror.y != 0 && (span_face == FACE_SOUTH || span_face == FACE_NORTH)) span_face = FACE_SOUTH + FACE_NORTH - span_face;
                return Hit(t_end, hit.slot, column, span_face, top, span);
            }
#endif
            if (span != 0u) return span_hit_in(walk, ray, Stay(t, t_end, face), Hit(t, hit.slot, column, face, top, span), bottom);
            hit.steps = 0u;
#endif
#ifdef SMOOTH
            if (node_corners(hit.slot) != 0u) {
                if (face == FACE_WEST || face == FACE_SOUTH) face += uint(face == FACE_WEST ? walk.mirror.x : walk.mirror.y);
                return Hit(t_end, hit.slot, column, side ? face : FACE_TOP, top, 0u);
            }
#endif
            return hit_in(walk, ray, Stay(t, t_end, face), Hit(t, hit.slot, column, face, top, hit.steps));
        }
        // Out of the section, to where the next one may begin.
        int crossed = face == FACE_WEST ? node.x : node.y;
        int up = min(max(ceiling - level, min(ups(crossed), frame.section_level - level)), frame.top_level - level);
        level += up;
        node >>= up;
    }
    hit.slot = NO_NODE;
    return hit;
}
