// What a frame's passes share: the frame's constants, the section table, the hit records, the rays.
// Needs pool.glsl.
#include "node.glsl"
#include "passes.glsl"

// The camera as the host gives it, ready for rays: origins are linear in the pixel and lie on a plane just
// before the bulk of the data; they are 32.32 fixed point, so that they are exact wherever the data is. Rays
// start behind that plane, at the eye: t is negative there.
struct Frame {
    uvec2 table;      // place of the section table
    uvec2 hits;       // place of the hit records, 4 words a pixel
    uvec2 colors;     // place of the summed colours, 4 floats a pixel
    uvec2 ramp;       // place of 256 colours, sRGB, and of the ground in rough outline
    uvec2 beams;      // place of the beams, a tile of pixels each
    uvec2 wide_beams; // and of the wider ones before them
    uint table_mask;  // slots of the table - 1
    int top_level;    // log2 cells of the side of the table's coarsest nodes
    int section_level; // and of its largest sections
    ivec2 low, high;  // what they cover, cells; high is exclusive
    uint width, height;
    ivec3 origin_int; // origin at the top left corner of the image's middle pixel: cells east, cells north, origin_step lattice steps up
    uvec3 origin_fraction;
    ivec3 right_int; // per pixel to the right
    uvec3 right_fraction;
    ivec3 down_int; // per pixel down
    uvec3 down_fraction;
    float depth;   // of the plane that origins lie on, lengths
    vec3 forward;  // direction through the image's centre, display space
    vec3 right;    // its change per sixteenth of a pixel to the right
    vec3 down;     // and down
    vec3 to_local; // lengths to cells, cells, lattice steps (the last holds the exaggeration); a length is a power of two of
                   // world units, at most a cell, so that numbers here do not depend on the unit
    float origin_step; // lattice steps in one step up of an origin: 1 unless the image is too tall for that
    int height_anchor; // lattice height of local height 0
    uint shade;        // SHADE_LIT, or 0: exact
    uint color_source; // COLOR_RGB and so on
    uint range_low;    // value below which there is one colour; heights biased by 2^31; of a palette what the high byte counts
    float range_scale; // entries a step of the value
    float range_offset; // entry of range_low
    float cell_steps;  // lattice steps in one cell side, exaggeration included: slopes
    vec3 sun;          // towards the sun
    uint background;   // BACKGROUND_NONE and so on
    // Lit images end in a slab as the ground is: place on that of a cell's western and southern border is
    // (cell - ground_first) * ground_scale + ground_at, in steps from height to height.
    ivec2 ground_first;
    vec2 ground_scale, ground_at;
    float slab;        // its thickness, lattice steps
    float cell_height; // lattice steps in one cell side, without exaggeration
    int slice_log2;    // log2 lattice steps of a slice of stacks of the finest cells
    vec2 pixel;        // cells from a pixel's ray to the next: at t = 0, and what a length of t adds where the direction is a length long
};

// One slot of the section table, an open-addressed hash over nodes of the quadtree (src/resident/table.rs).
struct Node {
    uvec2 key;    // level << 26 | index east (26 bits), index north; NO_KEY: unused
    uint top;     // highest thing below, lattice steps from the anchor, rounded up: bits of a float, the last set for sections
    uint meta;    // level | for sections: detail level, log2 of the side of a cell of what is shown here, << 16
    uvec2 pyramid; // of the pyramid of the section shown here, which may reach farther than the node: all bits of its place
    int base;      // lattice height of code 0, from the anchor
    uint form;     // how it lies: see section.glsl
    uint beside[4]; // slots of the sections of its size and detail to the east, west, north and south, or NO_NODE
    uint floats;    // 1 where something of its section may float
    uint corners;   // first word of its corners in what is derived of it; 0: its tops are no smooth surface
    uint joins;     // words from a span of it to what it is joined with; 0: spans are boxes
    uint pad;       // a cache line
};

bool is_section(uint top) { return (top & TOP_SECTION) != 0u; }

// Lavapipe recompiles a pipeline for the values of a uniform block that branches follow from, whenever the block is
// bound: a pass that is not worth that, in every frame, defines FRAME_STORED.
#ifdef FRAME_STORED
#define FRAME_BLOCK readonly buffer
#else
#define FRAME_BLOCK uniform
#endif

#ifdef POOL_SSBO
layout(set = 0, binding = 1, scalar) readonly buffer Table { Node nodes[]; };
layout(set = 0, binding = 2, scalar) FRAME_BLOCK FrameBlock { Frame frame; };
layout(set = 0, binding = 3, scalar) buffer Hits { uvec4 hits[]; };
layout(set = 0, binding = 4, scalar) buffer Colors { vec4 colors[]; };
layout(set = 0, binding = 5, scalar) readonly buffer Ramp { vec4 ramp[RAMP_ENTRIES]; float ground[]; };
layout(set = 0, binding = 6, scalar) buffer Beams { uint beams[]; };
layout(set = 0, binding = 7, scalar) buffer WideBeams { uint wide_beams[]; };
#define BEAM beams
#define WIDE_BEAM wide_beams
#define NODE nodes
#define HIT hits
#define COLOR colors
layout(set = 0, binding = 4, scalar) writeonly buffer Screen { uint screen[]; };
#define SCREEN_IMAGE screen
#define RAMP ramp
#define GROUND ground
#else
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer Table { Node nodes[]; };
layout(set = 0, binding = 0, scalar) FRAME_BLOCK FrameBlock { Frame frame; };
layout(buffer_reference, scalar, buffer_reference_align = 16) buffer Hits { uvec4 hits[]; };
layout(buffer_reference, scalar, buffer_reference_align = 16) buffer Colors { vec4 colors[]; };
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer Ramp { vec4 ramp[RAMP_ENTRIES]; float ground[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Beams { uint beams[]; };
#define BEAM Beams(frame.beams).beams
#define WIDE_BEAM Beams(frame.wide_beams).beams
#define NODE Table(frame.table).nodes
#define HIT Hits(frame.hits).hits
#define COLOR Colors(frame.colors).colors
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Screen { uint screen[]; };
#define SCREEN_IMAGE Screen(frame.colors).screen
#define RAMP Ramp(frame.ramp).ramp
#define GROUND Ramp(frame.ramp).ground
#endif
layout(push_constant, scalar) uniform Push {
    ivec2 sample_at; // of this pass's sample in the pixel, sixteenths from its top left corner
    uint sample_index;
    float sample_weight; // 1 / samples
    uint first_row, rows; // the band of the image that the hit records and colours are of
    ivec3 origin_int;     // origin at the sample of the image's middle pixel
    uvec3 origin_fraction;
} push;

#define log_node(slot, word) log_load(frame.table, (slot) * NODE_WORDS + uint(word))
#ifdef POOL_TEXELS
uint beam_at(uint tile) { return imageLoad(beam_texels, int(tile)).r; }
uint node_word(uint slot, uint word) { return imageLoad(table_texels, int(slot * NODE_WORDS) + int(word)).r; }
uvec2 node_key(uint slot) { return uvec2(node_word(slot, NODE_KEY), node_word(slot, NODE_KEY + 1u)); }
uint node_top(uint slot) { return node_word(slot, NODE_TOP); }
uint node_meta(uint slot) { return node_word(slot, NODE_META); }
uvec2 node_pyramid(uint slot) { return uvec2(node_word(slot, NODE_PYRAMID), node_word(slot, NODE_PYRAMID + 1u)); }
int node_base(uint slot) { return int(node_word(slot, NODE_BASE)); }
uint node_form(uint slot) { return node_word(slot, NODE_FORM); }
uint node_beside(uint slot, uint side) { return node_word(slot, NODE_BESIDE + side); }
uint node_floats(uint slot) { return node_word(slot, NODE_FLOATS); }
uint node_corners(uint slot) { return node_word(slot, NODE_CORNERS); }
uint node_joins(uint slot) { return node_word(slot, NODE_JOINS); }
#else
uint beam_at(uint tile) { log_load(frame.beams, tile); return BEAM[tile]; }
uvec2 node_key(uint slot) { log_node(slot, NODE_KEY); return NODE[slot].key; }
uint node_top(uint slot) { log_node(slot, NODE_TOP); return NODE[slot].top; }
uint node_meta(uint slot) { log_node(slot, NODE_META); return NODE[slot].meta; }
uvec2 node_pyramid(uint slot) { log_node(slot, NODE_PYRAMID); return NODE[slot].pyramid; }
int node_base(uint slot) { log_node(slot, NODE_BASE); return NODE[slot].base; }
uint node_form(uint slot) { log_node(slot, NODE_FORM); return NODE[slot].form; }
uint node_beside(uint slot, uint side) { log_node(slot, NODE_BESIDE + side); return NODE[slot].beside[side]; }
uint node_floats(uint slot) { log_node(slot, NODE_FLOATS); return NODE[slot].floats; }
uint node_corners(uint slot) { log_node(slot, NODE_CORNERS); return NODE[slot].corners; }
uint node_joins(uint slot) { log_node(slot, NODE_JOINS); return NODE[slot].joins; }
#endif

// t beyond which a ray has left everything; an axis along which it does not move is crossed later than that.
const float FAR = 1e15;

// Slot of the node `index` of `level`, or NO_NODE.
uint find_node(uint level, ivec2 index) {
    uint h = uint(index.x) * HASH_EAST ^ uint(index.y) * HASH_NORTH ^ level * HASH_LEVEL;
    h = (h ^ h >> HASH_SHIFT) * HASH_MIX;
    uint mask = frame.table_mask;
    uvec2 key = uvec2(level << KEY_LEVEL_SHIFT | uint(index.x) & KEY_INDEX_MASK, uint(index.y));
    for (uint slot = (h ^ h >> HASH_LAST_SHIFT) & mask;; slot = (slot + 1u) & mask) {
        uvec2 there = node_key(slot);
        if (there == key) return slot;
        if (there.x == NO_KEY) return NO_NODE;
    }
}

// Level of the finest cells of the section in `slot`.
int detail_of(uint slot) { return int(node_meta(slot) >> META_DETAIL_SHIFT); }

// Index of the node in `slot`.
ivec2 index_of(uint slot) { return ivec2(int(node_key(slot).x << 32u - KEY_LEVEL_SHIFT) >> 32u - KEY_LEVEL_SHIFT, int(node_key(slot).y)); }

// A hit record: x is t (lengths from the ray's origin, as float bits), y the table slot or NO_NODE for a
// miss, z the column (y << 8 | x) and the face << 16, w the column's top (lattice steps from the anchor, int bits).

struct Ray {
    ivec3 cell;    // integer part of the origin: cells, cells, origin_step lattice steps
    vec3 fraction; // and what is left, 0..1
    vec3 step;     // direction: cells, cells, lattice steps in one length
    vec3 world;    // unit direction in display space
    float start;   // t of the eye, 0 or less
    float unit;    // length of the direction: t of one unit of depth
};

void add(inout int integer, inout uint fraction, int other_int, uint other_fraction) {
    uint carry;
    fraction = uaddCarry(fraction, other_fraction, carry);
    integer += other_int + int(carry);
}

// Whether rows of groups are dealt out; otherwise groups have their own order.
layout(constant_id = ID_DEALT) const bool DEALT = true;

// The tile of this thread, groups being so large. Rows of groups are dealt out, the even ones first: a driver that
// gives each of its threads a stretch of a dispatch gives each as much of the sky as of the ground.
uvec2 dealt_tile(uvec3 group) {
    uint y = gl_WorkGroupID.y, rows = gl_NumWorkGroups.y;
    if (DEALT) {
        y *= 2u;
        if (y >= rows) y = (y - rows) | 1u;
    }
    return uvec2(gl_WorkGroupID.x, y) * group.xy + gl_LocalInvocationID.xy;
}

// The pixel of this thread, dealt out so. 32 threads in a row have 8x4 pixels, eight of them 4x2: they run together, and
// the squarer their pixels the more alike their rays. Groups that 8x4 does not fill have their pixels row by row.
uvec2 dealt_pixel(uvec3 group) {
    uvec2 first = dealt_tile(group) - gl_LocalInvocationID.xy;
    if (group.x % 8u != 0u || group.y % 4u != 0u) return first + gl_LocalInvocationID.xy;
    uint n = gl_LocalInvocationIndex, block = n >> 5u, across = group.x / 8u;
    return first + uvec2(block % across, block / across) * uvec2(8u, 4u)
         + uvec2(n & 3u | n >> 1u & 4u, n >> 2u & 1u | n >> 3u & 2u);
}

// How far a beam came (depths from the eye on; to 18 bits, and never too far), and its level.
uint beam_of(float s, int level) { return floatBitsToUint(max((s + frame.depth) * 0.9999998, 0.0)) & ~31u | uint(level); }
float beam_depth(uint beam) { return uintBitsToFloat(beam & ~31u) - frame.depth; }
int beam_level(uint beam) { return int(beam & 31u); }

// Adds n steps of `step_int:step_fraction`; |n| < 2^15.
void step_on(inout int integer, inout uint fraction, int step_int, uint step_fraction, int n) {
    int low = int(step_fraction & 0xFFFFu) * n, high = int(step_fraction >> 16u) * n;
    add(integer, fraction, step_int * n + (high + (low >> 16) >> 16), (uint(high) << 16u) + uint(low));
}

// Origin and direction of the ray `steps` pixels from the one whose origin is `first_int:first_fraction`: whole cells and
// what is left of them; direction in display space, 1 unit of depth long along the view. `from_centre`: sixteenths of a
// pixel from the image's centre.
void origin_at(ivec3 first_int, uvec3 first_fraction, ivec2 steps, ivec2 from_centre, out ivec3 cell, out vec3 rest, out vec3 direction) {
    for (int axis = 0; axis < 3; axis++) {
        int integer = first_int[axis];
        uint fraction = first_fraction[axis];
        step_on(integer, fraction, frame.right_int[axis], frame.right_fraction[axis], steps.x);
        step_on(integer, fraction, frame.down_int[axis], frame.down_fraction[axis], steps.y);
        // To 24 bits, which a float holds; to even, so that what is symmetrical stays so.
        add(integer, fraction, 0, 127u + (fraction >> 8u & 1u));
        cell[axis] = integer;
        rest[axis] = float(fraction >> 8u) * 5.9604644775390625e-8;
    }
    direction = frame.forward + float(from_centre.x) * frame.right + float(from_centre.y) * frame.down;
}

// Pixels from the image's middle one, and sixteenths of a pixel from its centre on.
ivec2 from_middle(uvec2 pixel) { return ivec2(pixel + uvec2(0u, push.first_row)) - ivec2(frame.width, frame.height) / 2; }
ivec2 odd_half() { return ivec2(frame.width & 1u, frame.height & 1u) * 8; }

// Height of a ray's origin, lattice steps from the anchor.
float origin_height(Ray ray) { return (float(ray.cell.z) + ray.fraction.z) * frame.origin_step; }

// The ray of this pass's sample of a pixel.
Ray ray_of(uvec2 pixel) {
    Ray ray;
    vec3 direction;
    // From the centre: what is symmetrical stays so, and a ray straight ahead is the camera's very own.
    ivec2 steps = from_middle(pixel);
    origin_at(push.origin_int, push.origin_fraction, steps, steps * 16 + push.sample_at - odd_half(), ray.cell, ray.fraction, direction);
    float unit = length(direction);
    ray.world = direction / unit;
    ray.step = ray.world * frame.to_local;
    ray.start = -frame.depth * unit;
    ray.unit = unit;
    return ray;
}

