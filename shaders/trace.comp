// The traversal: one ray a pixel through the quadtree of sections (the table), each section's maximum pyramid
// and, at its finest level, the column: top or side. Writes hit records.
//
// A ray's place is the finest cell it is in and t. A node's far border gives t directly from the ray's origin
// (never step by step), so no error builds up, and a node is passed over exactly when all its columns would be:
// t and z(t) round monotonically. A column is solid from its top down; a ray hits where it first is at or
// below a column's top inside that cell. Cells are half-open: a corner belongs to the cell north-east of it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"

layout(local_size_x_id = 0, local_size_y_id = 1) in;

// Inverse of a step that is none.
const float STILL = 1e30;

struct Walk {
    Ray ray;
    vec2 inverse; // 1 / ray.step.xy, or huge where the ray does not move
    ivec2 upward; // 1 where the ray goes east / north (or neither)
    ivec2 cell;   // finest cell
    float t;
    uint face; // through which side the cell was entered
};

// t at which the ray crosses `border` (a finest cell border) of each axis; beyond FAR where it runs along.
vec2 t_at(in Walk walk, ivec2 border) {
    return (vec2(border - walk.ray.cell.xy) - walk.ray.fraction.xy) * walk.inverse;
}

float z_at(in Walk walk, float t) { return fma(t, walk.ray.step.z, float(walk.ray.cell.z) + walk.ray.fraction.z); }

// t and axis at which the ray leaves the node of `level` that it is in.
void exit_of(in Walk walk, int level, out float t, out int axis, out ivec2 border) {
    border = (walk.cell >> level) + walk.upward << level;
    vec2 ts = t_at(walk, border);
    // At a corner an eastward step comes first, a westward one last.
    axis = (walk.upward.x != 0 ? ts.x <= ts.y : ts.x < ts.y) ? 0 : 1;
    t = max(ts[axis], walk.t);
}

// Whether the ray is in the node that it leaves at t, and does not only touch its corner on the way from the
// south-west to the north-east or back.
bool is_in(in Walk walk, float t) {
    return t > walk.t || walk.upward.x != walk.upward.y || walk.face == FACE_INSIDE;
}

// Cells that the ray is in at t, which rounding may put a border off: whether it has crossed a border is
// decided by the border's t alone, so that large steps lead where small ones do.
ivec2 cells_at(in Walk walk, float t) {
    ivec2 cell = walk.ray.cell.xy + ivec2(floor(fma(vec2(t), walk.ray.step.xy, walk.ray.fraction.xy)));
    vec2 entered = t_at(walk, cell + 1 - walk.upward), left = t_at(walk, cell + walk.upward);
    bool x_first = walk.upward.x != 0;
    bvec2 behind = bvec2(x_first ? left.x <= t : left.x < t, x_first ? left.y < t : left.y <= t);
    bvec2 before = bvec2(x_first ? entered.x > t : entered.x >= t, x_first ? entered.y >= t : entered.y > t);
    return cell + (2 * walk.upward - 1) * (ivec2(behind) - ivec2(before));
}

// Goes to where the ray leaves the node of `level` through `border` of `axis`.
void advance(inout Walk walk, int level, float t, int axis, ivec2 border) {
    ivec2 low = walk.cell >> level << level;
    ivec2 across = clamp(cells_at(walk, t), low, low + (1 << level) - 1);
    walk.cell = axis == 0 ? ivec2(border.x - 1 + walk.upward.x, across.y) : ivec2(across.x, border.y - 1 + walk.upward.y);
    walk.face = (axis == 0 ? FACE_WEST : FACE_SOUTH) + uint(1 - walk.upward[axis]);
    walk.t = t;
}

// Whether the ray has left the parent of the node of `level` whose border it has just crossed.
bool left_parent(int level, int axis, ivec2 border) {
    return ((border[axis] >> level) & 1) == 0;
}

// Walks the section in `slot`. True on a hit (the record is complete); false when the ray has left it.
bool walk_section(inout Walk walk, uint slot, inout uvec4 hit) {
    uint meta = NODE[slot].meta;
    int top_level = int(meta & 0xFFu), finest = int(meta >> 16u & 0xFFu);
    bool wide = (meta & NODE_WIDE) != 0u;
    uvec2 place = NODE[slot].place;
    uint pyramid = NODE[slot].pyramid;
    int base = NODE[slot].base;
    ivec2 section = walk.cell >> top_level;

    int level = top_level - 1;
    while (true) {
        float t;
        int axis;
        ivec2 border;
        exit_of(walk, level, t, axis, border);
        float lowest = z_at(walk, walk.ray.step.z < 0.0 ? t : walk.t);

        uint l = uint(level - finest);
        uint side = SECTION_SIDE >> l;
        uvec2 node = uvec2(walk.cell >> level) & (side - 1u);
        uint code = load_code(place, pyramid, pyramid_offset(l) + node.y * side + node.x, wide);
        int top = base + int(code);

        if (code != 0u && lowest <= float(top) && is_in(walk, t)) {
            if (level > finest) {
                level--;
                continue;
            }
            float enter = z_at(walk, walk.t);
            float t_hit = walk.t;
            if (enter > float(top)) {
                float to_top = (float(top - walk.ray.cell.z) - walk.ray.fraction.z) / walk.ray.step.z;
                t_hit = clamp(to_top, walk.t, t);
                walk.face = FACE_TOP;
            }
            // What the window does not hold is not there. The ray has left it, then.
            bool there = all(greaterThanEqual(walk.cell, FRAME.low)) && all(lessThan(walk.cell, FRAME.high));
            if (there) hit = uvec4(floatBitsToUint(t_hit), slot, node.y << SECTION_LOG2 | node.x | walk.face << 16u, uint(top));
            return true;
        }
        if (t > FAR) {
            walk.t = t;
            return false;
        }
        advance(walk, level, t, axis, border);
        if (walk.cell >> top_level != section) return false;
        if (left_parent(level, axis, border)) level = min(level + 1, top_level - 1);
    }
}

// Moves the walk on to where its ray is in what the table covers; false if it never is.
bool enter(inout Walk walk) {
    ivec2 low = FRAME.low, high = FRAME.high;
    bvec2 eastward = equal(walk.upward, ivec2(1));
    vec2 near = t_at(walk, mix(high, low, eastward)), far = t_at(walk, mix(low, high, eastward));
    // A ray that runs along an axis is always or never between its borders.
    bvec2 still = equal(walk.inverse, vec2(STILL));
    vec2 between = mix(vec2(-1.0), vec2(1.0), bvec2(walk.cell.x >= low.x && walk.cell.x < high.x, walk.cell.y >= low.y && walk.cell.y < high.y));
    near = mix(near, -STILL * between, still);
    far = mix(far, STILL * between, still);
    float t = max(near.x, near.y);
    if (t > walk.t) {
        walk.face = (near.x >= near.y ? FACE_WEST : FACE_SOUTH) + uint(1 - (near.x >= near.y ? walk.upward.x : walk.upward.y));
        walk.t = t;
    }
    walk.cell = clamp(cells_at(walk, walk.t), low, high - 1);
    return walk.t < min(far.x, far.y);
}

uvec4 trace(Ray ray) {
    Walk walk;
    walk.ray = ray;
    walk.inverse = mix(1.0 / ray.step.xy, vec2(STILL), lessThan(abs(ray.step.xy), vec2(1e-20)));
    walk.upward = ivec2(greaterThanEqual(walk.inverse, vec2(0.0)));
    walk.cell = ray.cell.xy;
    walk.t = ray.start;
    walk.face = FACE_INSIDE;

    uvec4 hit = uvec4(0u, NO_NODE, 0u, 0u);
    if (!enter(walk)) return hit;
    int level = FRAME.top_level;
    while (all(greaterThanEqual(walk.cell, FRAME.low)) && all(lessThan(walk.cell, FRAME.high))) {
        float t;
        int axis;
        ivec2 border;
        exit_of(walk, level, t, axis, border);
        float lowest = z_at(walk, ray.step.z < 0.0 ? t : walk.t);
        uint slot = find_node(uint(level), walk.cell >> level);
        if (slot != NO_NODE && lowest <= NODE[slot].top) {
            if ((NODE[slot].meta & NODE_SECTION) == 0u) {
                level--;
                continue;
            }
            ivec2 before = walk.cell >> level;
            if (walk_section(walk, slot, hit)) return hit;
            if (walk.t > FAR) break;
            // The walk stands in another section now: go on from the parent if that is another too.
            if (walk.cell >> level + 1 != before >> 1) level++;
        } else {
            if (t > FAR) break;
            advance(walk, level, t, axis, border);
            if (left_parent(level, axis, border)) level++;
        }
        level = min(level, FRAME.top_level);
    }
    return hit;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= FRAME.width || pixel.y >= push.rows) return;
    HIT[pixel.y * FRAME.width + pixel.x] = trace(ray_at(sample_of(pixel)));
}
