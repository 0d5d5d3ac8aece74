// The walk of one ray through nodes: the quadtree of sections (the table), and a section's maximum pyramid down to its
// columns.
//
// The ray is mirrored so that it goes east and north. Its place is the node it is in (index and level) and t. A
// node's far border gives t directly from the ray's origin (never step by step), so no error builds up; where in a
// node the ray is, is asked only on the way down, and answered by the t of the middle border. So large steps lead
// where small ones do, and a node is passed over exactly when all its columns would be: t and z(t) round
// monotonically. Cells are half-open: a corner belongs to the cell north-east of it.
//
// What a loop finds is assigned where a thread leaves it, to what was declared before it: lavapipe (Mesa 22.3) and
// SwiftShader go on computing other values for threads that have left.
// Needs pool.glsl, section.glsl, frame.glsl, lookup.glsl.

// Inverse of a step that is none.
const float STILL = 1e30;
// Level that no walk starts at: where it started is behind it.
const int STARTED = 64;

// Order of calls: begin_walk; then through_table and through_sections in turn, as long as the ray is not gone.
struct Walk {
    // The ray.
    ivec2 mirror;   // 1 where it goes west / south
    ivec2 origin;   // cell of the origin, mirrored
    vec2 fraction;  // and where in it
    vec2 inverse;   // lengths in one cell
    float z0, dz;   // lattice steps
    bool falls;
    bool diagonal;  // it goes to the south-west or the north-east
    ivec2 low, high; // what there is, mirrored
    float t_leave;  // where it has left that
    // Where it is.
    ivec2 cell;     // where it started
    int first;      // level that it starts at, then STARTED
    ivec2 node;
    int level;
    float t;
    uint face;      // of the border that it came through: FACE_WEST or FACE_SOUTH, mirrored; or none yet
    // Whether a stay of no length in a node counts: not where the ray only touches a corner on the way from the
    // south-west to the north-east or back.
    bool touches;
    // Where it leaves the node: t, and whether to the east, not to the north.
    float t_exit;
    bool east;
    bool gone;      // from all there is
    uint steps;     // nodes looked at
};

// t at which the ray crosses `border` (a finest cell border, mirrored) of each axis; beyond FAR where it runs along.
vec2 t_at(in Walk walk, ivec2 border) { return (vec2(border - walk.origin) - walk.fraction) * walk.inverse; }

// Which of `borders` the ray is past at t. At a corner an eastward step comes first, a westward one last.
ivec2 past(in Walk walk, ivec2 borders, float t) {
    vec2 ts = t_at(walk, borders);
    return walk.mirror.x == 0 ? ivec2(ts.x <= t, ts.y < t) : ivec2(ts.x < t, ts.y <= t);
}

// Levels that a walk can go up where it crossed `border` (nodes of its level); border 0 is one of all levels.
int ups(int border) { return findLSB(border | 1 << 30); }

// The node, not mirrored.
ivec2 real_node(in Walk walk) { return walk.node ^ -walk.mirror; }

// Looks at where the ray leaves its node.
void look(inout Walk walk) {
    walk.steps++;
    log_step();
    vec2 ts = t_at(walk, walk.node + 1 << walk.level);
    walk.east = walk.mirror.x == 0 ? ts.x <= ts.y : ts.x < ts.y;
    walk.t_exit = max(walk.east ? ts.x : ts.y, walk.t);
}

// Whether the ray is somewhere in its node at or below `top`.
bool is_below(in Walk walk, float top) { return fma(walk.falls ? walk.t_exit : walk.t, walk.dz, walk.z0) <= top; }

// To the child that the ray is in.
void go_down(inout Walk walk) {
    walk.level--;
    walk.node = walk.node * 2 + past(walk, (walk.node * 2 + 1) << walk.level, walk.t);
}

// To the node beside it.
void go_on(inout Walk walk) {
    walk.t = walk.t_exit;
    walk.node += ivec2(walk.east, !walk.east);
    walk.face = walk.east ? FACE_WEST : FACE_SOUTH;
    walk.touches = !walk.diagonal;
}

// Up by `up` levels.
void go_up(inout Walk walk, int up) {
    walk.level += up;
    walk.node >>= up;
}

// Levels to go up in the table where the ray has crossed `border` (its index among nodes of the level): at least `least`, and
// as far as a section may reach that begins here.
int table_ups(in Walk walk, int border, int least) {
    return min(max(least, min(ups(border), frame.section_level - walk.level)), frame.top_level - walk.level);
}

// A walk of `ray` from t `start` on, where it is known to be above everything, beginning at `level`; it may be gone at
// once.
Walk begin_walk(Ray ray, float start, int level) {
    Walk walk;
    walk.steps = 0u;
    // -0 and what is nearly 0 go east and north, and never arrive.
    bvec2 still = lessThan(abs(ray.step.xy), vec2(1e-20));
    walk.mirror = ivec2(lessThan(ray.step.xy, vec2(0.0))) * ivec2(not(still));
    walk.inverse = mix(abs(1.0 / ray.step.xy), vec2(STILL), still);
    walk.origin = ray.cell.xy ^ -walk.mirror;
    walk.fraction = mix(ray.fraction.xy, 1.0 - ray.fraction.xy, equal(walk.mirror, ivec2(1)));
    // Where a ray runs along an axis it stays in its cell, on a border or not: it was always, or is never, between two
    // others.
    walk.fraction = mix(walk.fraction, vec2(0.5), still);
    walk.z0 = origin_height(ray);
    walk.dz = ray.step.z;
    walk.falls = walk.dz < 0.0;
    walk.low = mix(frame.low, -frame.high, equal(walk.mirror, ivec2(1)));
    walk.high = mix(frame.high, -frame.low, equal(walk.mirror, ivec2(1)));

    // On to the border of what there is.
    vec2 enter = t_at(walk, walk.low), leave = t_at(walk, walk.high);
    walk.t = start;
    walk.face = start == ray.start ? FACE_INSIDE : FACE_TOP;
    // A ray that stands over one cell leaves it beyond everything.
    float t_enter = max(enter.x, enter.y);
    walk.t_leave = min(min(leave.x, leave.y), FAR);
    if (t_enter > walk.t) {
        walk.t = t_enter;
        walk.face = enter.x >= enter.y ? FACE_WEST : FACE_SOUTH;
    }
    walk.gone = walk.t >= walk.t_leave;

    // The finest cell that the ray is in; rounding may put it a border off.
    vec2 at = fma(vec2(walk.t), mix(abs(ray.step.xy), vec2(0.0), still), walk.fraction);
    ivec2 cell = clamp(walk.origin + ivec2(floor(at)), walk.low, walk.high - 1);
    ivec2 ahead = past(walk, cell + 1, walk.t), behind = 1 - past(walk, cell, walk.t);
    walk.cell = clamp(cell + ahead - behind * (1 - ahead), walk.low, walk.high - 1);

    walk.first = min(level, frame.top_level);
    walk.level = max(walk.first, frame.section_level);
    walk.node = walk.cell >> walk.level;
    walk.diagonal = walk.mirror.x == walk.mirror.y;
    walk.touches = !walk.diagonal || walk.face == FACE_INSIDE;
    return walk;
}

// Through the table to a section that may be hit; gives its slot, unless the ray is gone.
uint through_table(inout Walk walk) {
    uint found = NO_NODE;
    while (true) {
        look(walk);
        uint slot = find_node(uint(walk.level), real_node(walk));
        uint top = slot != NO_NODE ? node_top(slot) : 0u;
        // A ray that starts below the table's levels is near something.
        bool down = slot != NO_NODE && (is_below(walk, uintBitsToFloat(top)) || walk.first < walk.level);
        if (down && is_section(top)) {
            found = slot;
            break;
        }
        if (down) {
            go_down(walk);
        } else {
            walk.gone = !(walk.t_exit < walk.t_leave);
            if (walk.gone) break;
            walk.first = STARTED;
            go_on(walk);
            // Up where a 2x2 square of nodes ends.
            int border = walk.east ? walk.node.x : walk.node.y;
            go_up(walk, table_ups(walk, border, ~border & 1));
        }
    }
    return found;
}

// Down the pyramid of the section in `slot`, and on from section to section as long as they are of one size, to the first
// column that is hit, whose height is `top`. False where there is none: the ray then is gone, or in the table again.
bool through_sections(inout Walk walk, inout uint slot, int detail, out int top) {
    // A node of a section that reaches farther ends where the node does, and may be smaller than its cells.
    int ceiling = walk.level, finest = min(detail, walk.level - 1);
    if (walk.first < ceiling) {
        walk.level = max(walk.first, finest);
        walk.node = walk.cell >> walk.level;
        walk.first = STARTED;
    } else {
        go_down(walk);
    }
    top = 0;
    float t_end = 0.0;
    bool found = false;
    while (true) {
        Section section = section_in(slot, detail);
        while (true) {
            look(walk);
            uint code = code_at(section, walk.level, real_node(walk));
            int highest = height_of(section, code);
            bool down = code != 0u && is_below(walk, float(highest)) && (walk.t_exit > walk.t || walk.touches);
            if (down && walk.level == finest) {
                found = true;
                top = highest;
                t_end = walk.t_exit;
                break;
            }
            if (down) {
                go_down(walk);
            } else {
                walk.gone = !(walk.t_exit < walk.t_leave);
                go_on(walk);
                int border = walk.east ? walk.node.x : walk.node.y;
                if (walk.gone || (border & (1 << ceiling - walk.level) - 1) == 0) break;
                go_up(walk, ~border & 1);
            }
        }
        if (found || walk.gone) break;
        // The level stays as it is: what is near the ray here is near it there. What has climbed to the section's
        // own size goes on in the table, which skips more.
        if (walk.level == ceiling - 1) break;
        uint next = node_beside(slot, uint(walk.face == FACE_WEST ? walk.mirror.x : 2 + walk.mirror.y));
        if (next == NO_NODE) break;
        slot = next;
        go_up(walk, 1);
    }
    walk.t_exit = t_end;
    // Out of the section, to where the next one may begin.
    int border = walk.face == FACE_WEST ? walk.node.x : walk.node.y;
    if (!found) go_up(walk, table_ups(walk, border, ceiling - walk.level));
    return found;
}
