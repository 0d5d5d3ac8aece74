//! The section table as shaders see it.

use super::common::{self, LAVAPIPE, SWIFTSHADER};
use lasray::coords::{Height, SectionKey};
use lasray::gpu::{BindingKind, Buffer, BufferCopy, ComputePipeline, Gpu, MemoryKind, Order};
use lasray::resident::table::{Entry, Node, Table};

#[allow(dead_code)] // each test binary uses its part
mod shaders {
    include!(concat!(env!("OUT_DIR"), "/test_shaders.rs"));
}

const GROUP: u32 = 64;
/// More than `Frame` of `shaders/frame.glsl` has.
const FRAME_BYTES: u64 = 1024;
/// Where it has `hits`, and `table_mask`.
const HITS: usize = 8;
const TABLE_MASK: usize = 48;

/// Addresses as drivers hand them out: those of RADV, which are in the upper half of 64 bits, those of others, and all
/// bits.
const ADDRESSES: [u64; 6] =
    [0xffff_8000_0000_0000, 0xffff_8001_2345_6700, 0xffff_ffff_ffff_ff00, 0x7fff_ffff_ff00, 0x1000, u64::MAX];

fn table() -> (Vec<Entry>, Table) {
    let entries: Vec<_> = (0..40)
        .map(|k| {
            let address = ADDRESSES[k as usize % ADDRESSES.len()] ^ (k as u64) << 8;
            Entry {
                floats: None,
                corners: None,
                joins: None,
                key: SectionKey { level: 0, i: k % 7, j: k / 7 },
                detail: 0,
                pyramid: [address as u32, (address >> 32) as u32],
                base: Height(-1000 * k),
                form: u32::from(k % 3 == 0),
                top: Height(100 * k),
            }
        })
        .collect();
    let table = Table::build(&entries, Height(50));
    (entries, table)
}

/// The kind of each binding.
type Kinds = fn(usize) -> BindingKind;

/// What each slot says by the shader that is given so.
fn decoded(gpu: &Gpu, table: &Table, words: &'static [u32], kind: Kinds) -> Vec<[u32; 4]> {
    let slots: &[u8] = bytemuck::cast_slice(&table.slots);
    let bytes = 16 * table.slots.len() as u64;
    let upload = |name, size| Buffer::new(gpu, name, MemoryKind::Upload, size).unwrap();
    let (nodes, frame) = (upload("table", slots.len() as u64), upload("frame", FRAME_BYTES));
    let hits = Buffer::new(gpu, "hits", MemoryKind::Device, bytes).unwrap();
    let back = Buffer::new(gpu, "back", MemoryKind::Readback, bytes).unwrap();
    nodes.write(0, slots);
    let mut constants = vec![0; FRAME_BYTES as usize];
    constants[..HITS].copy_from_slice(&nodes.address().to_le_bytes());
    constants[HITS..HITS + 8].copy_from_slice(&hits.address().to_le_bytes());
    let mask = table.slots.len() as u32 - 1;
    constants[TABLE_MASK..TABLE_MASK + 4].copy_from_slice(&mask.to_le_bytes());
    frame.write(0, &constants);

    let given: &[&Buffer] = match kind(0) {
        BindingKind::Storage => &[&nodes, &nodes, &frame, &hits, &hits, &hits, &hits, &hits],
        _ if kind(1) == BindingKind::Texels => &[&frame, &nodes, &nodes, &nodes],
        _ => &[&frame],
    };
    let kinds: Vec<_> = (0..given.len()).map(kind).collect();
    let program = ComputePipeline::new(gpu, "decode", words, &[(0, GROUP)], 0, &kinds).unwrap();
    let mut order = Order::new(gpu, 1).unwrap();
    let (mut commands, _) = order.begin_frame("decode").unwrap();
    [&nodes, &frame, &hits].iter().for_each(|&buffer| commands.keep(buffer.clone()));
    commands.bind(&program);
    commands.bind_buffers(&program.binding(given).unwrap());
    commands.dispatch([(table.slots.len() as u32).div_ceil(GROUP), 1, 1]);
    order.readback(&mut commands, &[(&hits, &back, BufferCopy { from: 0, to: 0, size: bytes })]);
    let point = order.submit(commands).unwrap();
    let mut found = vec![[0; 4]; table.slots.len()];
    order.read(point, &back, 0, bytemuck::cast_slice_mut(&mut found)).unwrap();
    found
}

#[test]
fn places_keep_all_their_bits() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("table::places_keep_all_their_bits", setup, |setup| {
            let gpu = setup.gpu();
            let (entries, table) = table();
            let named: Vec<_> = entries
                .iter()
                .map(|e| {
                    let [x, y] = e.pyramid;
                    let base = e.base.0.wrapping_sub(50) as u32;
                    [x, y, base, e.form]
                })
                .collect();
            let of = |node: &Node| [node.pyramid[0], node.pyramid[1], node.base as u32, node.form];
            let on_host: Vec<_> = table.slots.iter().map(of).collect();
            assert!(named.iter().all(|section| on_host.contains(section)));
            let variants: [(&'static [u32], Kinds); 3] = [
                (shaders::TABLE, |_| BindingKind::Uniform),
                (shaders::TABLE_TEXELS, |k| if k == 0 { BindingKind::Uniform } else { BindingKind::Texels }),
                (shaders::TABLE_SSBO, |k| if k == 2 { BindingKind::Uniform } else { BindingKind::Storage }),
            ];
            for (k, (words, kind)) in variants.into_iter().enumerate() {
                assert_eq!(decoded(&gpu, &table, words, kind), on_host, "variant {k}");
            }
            assert_eq!(gpu.messages(), [""; 0]);
        });
    }
}
