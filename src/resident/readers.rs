//! For tests: the shaders that read section tables, whose structs are compared with those of the Rust side.

use crate::gpu::layout::addresses;

/// The shaders that follow section tables, by address and through storage buffers.
pub fn readers_of_tables() -> [(&'static str, &'static [u32]); 22] {
    use crate::gpu::shaders::*;
    [
        ("beam", BEAM),
        ("beam, POOL_SSBO", BEAM_SSBO),
        ("trace", TRACE),
        ("trace, POOL_SSBO", TRACE_SSBO),
        ("exact", EXACT),
        ("exact, POOL_SSBO", EXACT_SSBO),
        ("plain", PLAIN),
        ("plain, POOL_SSBO", PLAIN_SSBO),
        ("shade", SHADE),
        ("shade, POOL_SSBO", SHADE_SSBO),
        ("trace, STACKED", TRACE_STACKED),
        ("trace, STACKED, POOL_SSBO", TRACE_STACKED_SSBO),
        ("exact, STACKED", EXACT_STACKED),
        ("exact, STACKED, POOL_SSBO", EXACT_STACKED_SSBO),
        ("shade, STACKED", SHADE_STACKED),
        ("shade, STACKED, POOL_SSBO", SHADE_STACKED_SSBO),
        ("trace, SMOOTH", TRACE_SMOOTH),
        ("trace, SMOOTH, POOL_SSBO", TRACE_SMOOTH_SSBO),
        ("exact, SMOOTH", EXACT_SMOOTH),
        ("exact, SMOOTH, POOL_SSBO", EXACT_SMOOTH_SSBO),
        ("shade, SMOOTH", SHADE_SMOOTH),
        ("shade, SMOOTH, POOL_SSBO", SHADE_SMOOTH_SSBO),
    ]
}

/// The shaders that read pool, table and beams as texels.
pub fn readers_of_texels() -> [(&'static str, &'static [u32]); 11] {
    use crate::gpu::shaders::*;
    [
        ("beam, POOL_TEXELS", BEAM_TEXELS),
        ("trace, POOL_TEXELS", TRACE_TEXELS),
        ("exact, POOL_TEXELS", EXACT_TEXELS),
        ("plain, POOL_TEXELS", PLAIN_TEXELS),
        ("shade, POOL_TEXELS", SHADE_TEXELS),
        ("trace, STACKED, POOL_TEXELS", TRACE_STACKED_TEXELS),
        ("exact, STACKED, POOL_TEXELS", EXACT_STACKED_TEXELS),
        ("shade, STACKED, POOL_TEXELS", SHADE_STACKED_TEXELS),
        ("trace, SMOOTH, POOL_TEXELS", TRACE_SMOOTH_TEXELS),
        ("exact, SMOOTH, POOL_TEXELS", EXACT_SMOOTH_TEXELS),
        ("shade, SMOOTH, POOL_TEXELS", SHADE_SMOOTH_TEXELS),
    ]
}

#[test]
fn no_shader_changes_a_bit_of_an_address() {
    use crate::gpu::shaders::*;
    let derive = [
        ("tops", TOPS),
        ("stack tops", STACK_TOPS),
        ("floaters", FLOATERS),
        ("means", MEANS),
        ("bridge", BRIDGE),
        ("fill", FILL),
        ("corners", CORNERS),
        ("pyramid", PYRAMID),
    ];
    let others = [("thesis", THESIS)];
    for (name, words) in
        readers_of_tables().into_iter().chain(readers_of_texels()).chain(derive).chain(others)
    {
        match addresses(words) {
            Ok(count) => assert!(count > 0 || name.ends_with("SSBO"), "{name} follows no address"),
            Err(changed) => panic!("{name} computes with the bits of an address: {changed:?}"),
        }
    }
}
