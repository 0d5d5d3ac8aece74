// Finding what lies at a place: the section that the table has there, and how high it is.
// Needs pool.glsl, section.glsl, frame.glsl.

// What look-ups need of a section that is shown in a node.
struct Section {
    uvec2 pyramid; // its place
    int base;      // lattice height of code 0, from the anchor
    int detail;    // level of its finest cells
    uint form;     // how it lies
};

// The section in `slot`, whose detail is known.
Section section_in(uint slot, int detail) { return Section(node_pyramid(slot), node_base(slot), detail, node_form(slot)); }

// Code of the highest thing in node `index` of `level`; a node smaller than the section's cells stands for its cell. 0:
// nothing is there.
uint code_at(Section section, int level, ivec2 index) {
    int at = max(level, section.detail);
    uint l = uint(at - section.detail);
    return pyramid_code(section.pyramid, l, uvec2(index >> at - level) & (SECTION_SIDE >> l) - 1u, section.form);
}

// Height of a code, lattice steps from the anchor.
int height_of(Section section, uint code) { return section.base + int(code); }

// Slot of the section around node `index` of `level`, or of that very node, and its top; NO_NODE where nothing is. From the
// largest section that the node may be part of on down; `at`: the level where the search ended.
uint find_around(int level, ivec2 index, out int at, out uint top) {
    uint slot = NO_NODE;
    top = 0u;
    for (at = max(level, frame.section_level); at >= max(level, int(SECTION_LOG2)); at--) {
        slot = find_node(uint(at), index >> at - level);
        // What is there has all its ancestors in the table; the finest of them are sections.
        if (slot == NO_NODE) break;
        top = node_top(slot);
        if (at == level || is_section(top)) return slot;
    }
    return NO_NODE;
}

// The node that the last look-up was in: the next is nearly always in the same one.
struct Here {
    ivec2 node;
    int level; // log2 finest cells of its side
    uint slot; // NO_NODE: nothing
};

// Whether node `index` of `level`, which is no larger, lies in it.
bool is_in(Here here, int level, ivec2 index) { return index >> here.level - level == here.node; }
