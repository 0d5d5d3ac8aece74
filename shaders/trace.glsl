// The traversal: one ray through the quadtree of sections (the table), a section's maximum pyramid and, at its
// finest level, the column: top or side.
//
// The ray is mirrored so that it goes east and north. Its place is the node it is in (index and level) and t. A
// node's far border gives t directly from the ray's origin (never step by step), so no error builds up; where in a
// node the ray is, is asked only on the way down, and answered by the t of the middle border. So large steps lead
// where small ones do, and a node is passed over exactly when all its columns would be: t and z(t) round
// monotonically. A column is solid from its top down; a ray hits where it first is at or below a column's top
// inside that cell. Cells are half-open: a corner belongs to the cell north-east of it.
// Needs pool.glsl, section.glsl, frame.glsl.

// Inverse of a step that is none.
const float STILL = 1e30;

struct Walk {
    ivec2 mirror;   // 1 where the ray goes west / south
    ivec2 origin;   // cell of the origin, mirrored
    vec2 fraction;  // and where in it
    vec2 inverse;   // world units in one cell
    float z0, dz;   // lattice steps
};

// t at which the ray crosses `border` (a finest cell border, mirrored) of each axis; beyond FAR where it runs along.
vec2 t_at(in Walk walk, ivec2 border) { return (vec2(border - walk.origin) - walk.fraction) * walk.inverse; }

// Which of `borders` the ray is past at t. At a corner an eastward step comes first, a westward one last.
ivec2 past(in Walk walk, ivec2 borders, float t) {
    vec2 ts = t_at(walk, borders);
    return walk.mirror.x == 0 ? ivec2(ts.x <= t, ts.y < t) : ivec2(ts.x < t, ts.y <= t);
}

// What a ray found: see the hit record in frame.glsl.
struct Hit {
    float t;
    uint slot; // NO_NODE: nothing
    uvec2 column;
    uint face;
    int top;
};

// Traces `ray` from t `start` on, where it is known to be above everything, beginning at `level`.
Hit trace(Ray ray, float start, int level) {
    Hit hit = Hit(0.0, NO_NODE, uvec2(0), 0u, 0);
    Walk walk;
    // -0 and what is nearly 0 go east and north, and never arrive.
    bvec2 still = lessThan(abs(ray.step.xy), vec2(1e-20));
    walk.mirror = ivec2(lessThan(ray.step.xy, vec2(0.0))) * ivec2(not(still));
    walk.inverse = mix(abs(1.0 / ray.step.xy), vec2(STILL), still);
    walk.origin = ray.cell.xy ^ -walk.mirror;
    walk.fraction = mix(ray.fraction.xy, 1.0 - ray.fraction.xy, equal(walk.mirror, ivec2(1)));
    // Where a ray runs along an axis it stays in its cell, on a border or not.
    walk.fraction = mix(walk.fraction, vec2(0.5), still);
    walk.z0 = float(ray.cell.z) + ray.fraction.z;
    walk.dz = ray.step.z;
    ivec2 low = mix(frame.low, -frame.high, equal(walk.mirror, ivec2(1)));
    ivec2 high = mix(frame.high, -frame.low, equal(walk.mirror, ivec2(1)));

    // On to the border of what there is.
    vec2 enter = t_at(walk, low), leave = t_at(walk, high);
    // A ray that runs along an axis is always or never between its borders.
    bvec2 within = bvec2(walk.origin.x >= low.x && walk.origin.x < high.x, walk.origin.y >= low.y && walk.origin.y < high.y);
    enter = mix(enter, mix(vec2(STILL), vec2(-STILL), within), still);
    leave = mix(leave, mix(vec2(-STILL), vec2(STILL), within), still);
    float t = start;
    uint face = start == ray.start ? FACE_INSIDE : FACE_TOP;
    float t_enter = max(enter.x, enter.y), t_leave = min(leave.x, leave.y);
    if (t_enter > t) {
        t = t_enter;
        face = enter.x >= enter.y ? FACE_WEST : FACE_SOUTH;
    }
    if (t >= t_leave) return hit;

    // The finest cell that the ray is in; rounding may put it a border off.
    vec2 at = fma(vec2(t), mix(abs(ray.step.xy), vec2(0.0), still), walk.fraction);
    ivec2 cell = clamp(walk.origin + ivec2(floor(at)), low, high - 1);
    ivec2 ahead = past(walk, cell + 1, t), behind = 1 - past(walk, cell, t);
    cell = clamp(cell + ahead - behind * (1 - ahead), low, high - 1);

    // The section that the ray is in: nodes of levels finest to ceiling - 1 are its pyramid's. Above, the table's.
    int finest = 0, ceiling = 0;
    uint slot = NO_NODE, pyramid = 0u;
    uvec2 place = uvec2(0);
    int base = 0;
    bool wide = false;
    ivec2 node;
#define ENTER(found, at)                      \
    uint meta = NODE[found].meta;             \
    if ((meta & NODE_SECTION) != 0u) {        \
        ceiling = at;                         \
        finest = int(meta >> 16u & 0xFFu);    \
        wide = (meta & NODE_WIDE) != 0u;      \
        place = NODE[found].place;            \
        pyramid = NODE[found].pyramid;        \
        base = NODE[found].base;              \
    }
    // Below the table's levels the walk begins in a section, if there is one.
    for (int at = frame.section_level; at >= int(SECTION_LOG2) && level < at && ceiling == 0; at--) {
        slot = find_node(uint(at), (cell ^ -walk.mirror) >> at);
        if (slot != NO_NODE) {
            ENTER(slot, at)
        }
    }
    if (ceiling == 0) level = max(level, frame.section_level);
    else level = max(level, finest);
    node = cell >> level;

    while (true) {
        vec2 ts = t_at(walk, node + 1 << level);
        bool east = walk.mirror.x == 0 ? ts.x <= ts.y : ts.x < ts.y;
        float t_exit = max(east ? ts.x : ts.y, t);
        float lowest = fma(walk.dz < 0.0 ? t_exit : t, walk.dz, walk.z0);
        ivec2 real = node ^ -walk.mirror;

        bool down;
        int top = 0;
        if (level >= ceiling) {
            slot = find_node(uint(level), real);
            down = slot != NO_NODE && lowest <= NODE[slot].top;
            if (down) {
                ENTER(slot, level)
            }
        } else {
            uint l = uint(level - finest), side = SECTION_SIDE >> l;
            uvec2 inner = uvec2(real) & (side - 1u);
            uint code = load_code(place, pyramid, pyramid_offset(l) + inner.y * side + inner.x, wide);
            top = base + int(code);
            // Not where the ray only touches a corner on the way from the south-west to the north-east or back.
            down = code != 0u && lowest <= float(top)
                && (t_exit > t || walk.mirror.x != walk.mirror.y || face == FACE_INSIDE);
            if (down && level == finest) {
                // What the window does not hold is not there; the ray has left it, then.
                if (any(lessThan(node << level, low)) || any(greaterThanEqual(node << level, high))) return hit;
                float z = fma(t, walk.dz, walk.z0);
                if (z > float(top)) {
                    face = FACE_TOP;
                    t = clamp((float(top - ray.cell.z) - ray.fraction.z) / walk.dz, t, t_exit);
                }
                if (face == FACE_WEST || face == FACE_SOUTH) face += uint(face == FACE_WEST ? walk.mirror.x : walk.mirror.y);
                return Hit(t, slot, inner, face, top);
            }
        }
        if (down) {
            level--;
            node = node * 2 + past(walk, (node * 2 + 1) << level, t);
            continue;
        }
        if (!(t_exit < t_leave)) return hit;
        t = t_exit;
        int crossed;
        if (east) {
            node.x++;
            crossed = node.x;
            face = FACE_WEST;
        } else {
            node.y++;
            crossed = node.y;
            face = FACE_SOUTH;
        }
        // Up where a 2x2 square of nodes ends. Where the section ends, to where the next one may begin: it can be as
        // large as the border that was crossed allows, and as the table's largest.
        int up = crossed & 1 ^ 1;
        bool leaves = level >= ceiling || (crossed & (1 << ceiling - level) - 1) == 0;
        if (leaves) {
            up = max(up, min(findLSB(crossed), frame.section_level - level));
            ceiling = 0;
        }
        up = min(up, frame.top_level - level);
        level += up;
        node >>= up;
    }
}
