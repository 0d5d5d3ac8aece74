// Corners of columns whose tops are a smooth surface: see the drawing in docs/from-file-to-pixel.md. They are last of what is
// derived of a section.
// Needs pool.glsl, section.glsl.

// First of a column's words; `corners`: the first of all.
uint corners_at(uint corners, uvec2 column, uint wide) {
    return corners + ((block_of(column) << 2u * DERIVED_BLOCK_LOG2 | in_block(column)) * CORNER_WORDS << wide);
}

// Codes of a column's corners: south-west, south-east, north-west, north-east; the first is 0 where there is no column.
uvec4 corners_of(uvec2 place, uint corners, uvec2 column, uint wide) {
    uint at = corners_at(corners, column, wide), a = pool_load(place, at), b = pool_load(place, at + 1u);
    if (wide != 0u) return uvec4(a, b, pool_load(place, at + 2u), pool_load(place, at + 3u));
    return uvec4(a & MOST_NARROW_CODE, a >> 16u, b & MOST_NARROW_CODE, b >> 16u);
}
