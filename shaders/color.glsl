// What is seen of a column: its run on show, and the colour that it has.
// Needs pool.glsl, section.glsl, frame.glsl.

const uint ORIGIN_MEASURED = 0u;
const uint ORIGIN_BRIDGED = 1u;

vec3 linear_of(vec3 srgb) { return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), greaterThan(srgb, vec3(0.04045))); }

vec3 bytes(uint packed_bytes) { return vec3(packed_bytes & 0xFFu, packed_bytes >> 8u & 0xFFu, packed_bytes >> 16u & 0xFFu) / 255.0; }

// The section that the last look-up was in: neighbours are nearly always in the same one.
struct Here {
    ivec2 section;
    uint slot;
    uint level; // log2 cells of its side
};

void go_to(inout Here here, ivec2 column) {
    ivec2 section = column >> int(SECTION_LOG2);
    if (section == here.section) return;
    here.section = section;
    here.slot = find_node(here.level, section);
}

// The run on show in a column.
struct Seen {
    vec3 srgb;
    uint class_;
    bool bridged;
};

// Whether sections have bridges, and whether colours are RGB: constants of the program, so that it does only what it
// must.
layout(constant_id = 2) const bool BRIDGES = true;
layout(constant_id = 3) const bool RAMPED = true;

// What is seen of `column` (cells of its detail level), whose top is `top` (lattice steps from the anchor).
Seen seen_at(inout Here here, ivec2 column, uint top) {
    uvec2 tops = tops_place(pyramid_place(NODE[here.slot].pyramid));
    uint runs = NODE[here.slot].attributes;
    uint ordered = block_order(uvec2(column) & (SECTION_SIDE - 1u));
    Seen seen;
    seen.bridged = false;
    bool there = true;
    if (BRIDGES) {
        uint bridge = pool_load(tops, SECTION_SIDE * SECTION_SIDE + ordered / 4u) >> (8u * (ordered & 3u)) & 0xFFu;
        if (bridge != 0u) {
            // A bridged column shows the run of the column it was taken from.
            ivec2 source = column + decode_bridge(bridge);
            go_to(here, source);
            there = here.slot != NO_NODE;
            if (there) {
                tops = tops_place(pyramid_place(NODE[here.slot].pyramid));
                runs = NODE[here.slot].attributes;
            }
            ordered = block_order(uvec2(source) & (SECTION_SIDE - 1u));
            seen.bridged = true;
        }
    }
    // A neighbour that has been built but not named yet shows black for a frame.
    uint run = there ? pool_load(tops, ordered) : NO_RUN;
    uint first = 0u, second = 0u;
    if (run != NO_RUN) {
        // Attributes end where the tops begin.
        uvec2 attributes = pool_back(tops, runs - 2u * run);
        first = pool_load(attributes, 0u);
        second = pool_load(attributes, 1u);
    }
    seen.class_ = first >> 24u;
    if (RAMPED && frame.color_source != 0u) {
        uint value = frame.color_source == 1u ? (top + uint(frame.height_anchor)) ^ 0x80000000u
                   : frame.color_source == 2u ? first >> 24u
                   : frame.color_source == 3u ? first >> 8u & 0xFFFFu
                                              : second >> 8u & 0xFFu;
        float at_entry = value > frame.range_low ? min(float(value - frame.range_low) * frame.range_scale, 255.0) : 0.0;
        uint entry = uint(at_entry);
        seen.srgb = mix(RAMP[entry].rgb, RAMP[min(entry + 1u, 255u)].rgb, at_entry - float(entry));
    } else {
        seen.srgb = bytes((first & 0xFFu) | (second >> 24u) << 8u | (second >> 16u & 0xFFu) << 16u);
    }
    return seen;
}

// Second word of a finished hit record.
uint bits_of(Seen seen, uint face) { return seen.class_ | (seen.bridged ? ORIGIN_BRIDGED : ORIGIN_MEASURED) << 9u | face << 12u; }
const uint BITS_MISS = 256u;

vec3 sky(vec3 direction) {
    // A bright haze at the horizon, soft blue above, quiet grey below.
    float up = direction.z;
    vec3 above = mix(vec3(0.80, 0.87, 0.94), vec3(0.30, 0.49, 0.76), smoothstep(0.0, 0.7, up));
    vec3 below = mix(vec3(0.80, 0.85, 0.90), vec3(0.60, 0.65, 0.70), smoothstep(0.0, 0.8, -up));
    return up >= 0.0 ? above : below;
}

// What is behind the data, linear.
vec4 background(vec3 direction) {
    vec4 color = vec4(frame.background == 1u ? vec3(1.0) : vec3(0.0), frame.background == 0u ? 0.0 : 1.0);
    if (frame.background == 2u) color = vec4(linear_of(sky(direction)), 1.0);
    return color;
}
