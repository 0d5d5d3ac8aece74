//! A small program of the real shape: two slots, an upload ring smaller than two sections, builds of two
//! passes, frames with a table, two passes and a readback. It notes every access that it makes.

use std::ops::Range;

use ash::vk::PipelineStageFlags2 as Stages;
use lasray::gpu::{
    BindingKind, Buffer, BufferCopy, Commands, ComputePipeline, Edge, Event, Gpu, MemoryKind, Order, Result,
    SyncPoint, UploadRing,
};

use crate::model::{Agent, Step, Touch};

#[allow(dead_code)] // each test binary uses its part
mod shaders {
    include!(concat!(env!("OUT_DIR"), "/test_shaders.rs"));
}

/// Elements (u32) in every buffer.
const COUNT: u32 = 4096;
const BYTES: u64 = 4 * COUNT as u64;
const GROUP: u32 = 64;
/// What a pass shifts by: into another workgroup, at the other end of the buffer.
const SHIFT: u32 = COUNT / 2;
const FRAMES: usize = 4;

/// How shaders reach memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Access {
    /// As shipped: frames read through a table of addresses.
    Address,
    /// What synchronization validation sees.
    StorageBuffer,
}

#[derive(Clone)]
struct Slot<T> {
    runs: T,
    tops: T,
    derived: T,
}

pub struct Rig {
    order: Order,
    ring: UploadRing,
    slots: [Slot<Buffer>; 2],
    /// What the slots are meant to hold.
    meant: [Slot<Vec<u32>>; 2],
    tables: [Buffer; 2],
    traced: Buffer,
    image: Buffer,
    readbacks: [Buffer; FRAMES],
    map: ComputePipeline,
    gather: ComputePipeline,
    access: Access,
    /// Accesses, each with the number of events before it.
    touches: Vec<(usize, Touch)>,
    /// Frames that were submitted, with the picture that is meant.
    frames: Vec<(SyncPoint, Vec<u32>)>,
}

impl Rig {
    pub fn new(gpu: &Gpu, access: Access, without: Option<Edge>) -> Result<Rig> {
        let device = |name: &str| Buffer::new(gpu, name, MemoryKind::Device, BYTES);
        let slot = |i: usize| -> Result<Slot<Buffer>> {
            Ok(Slot {
                runs: device(&format!("runs {i}"))?,
                tops: device(&format!("tops {i}"))?,
                derived: device(&format!("derived {i}"))?,
            })
        };
        let empty = || Slot { runs: Vec::new(), tops: Vec::new(), derived: Vec::new() };
        let table = |i: usize| Buffer::new(gpu, &format!("table {i}"), MemoryKind::Upload, 16);
        let readback = |i: usize| Buffer::new(gpu, &format!("readback {i}"), MemoryKind::Readback, BYTES);
        let (map_words, bound) = match access {
            Access::Address => (shaders::MAP, &[][..]),
            Access::StorageBuffer => (shaders::MAP_SSBO, &[BindingKind::Storage; 2][..]),
        };
        let order = Order::new(gpu, 2)?.recording();
        Ok(Rig {
            order: match without {
                Some(edge) => order.without(edge),
                None => order,
            },
            ring: UploadRing::new(gpu, "ring", BYTES)?,
            slots: [slot(0)?, slot(1)?],
            meant: [empty(), empty()],
            tables: [table(0)?, table(1)?],
            traced: device("traced")?,
            image: device("image")?,
            readbacks: [readback(0)?, readback(1)?, readback(2)?, readback(3)?],
            map: ComputePipeline::new(gpu, "map", map_words, &[(0, GROUP)], 28, bound)?,
            gather: ComputePipeline::new(gpu, "gather", shaders::GATHER, &[(0, GROUP)], 20, &[])?,
            access,
            touches: Vec::new(),
            frames: Vec::new(),
        })
    }

    /// Uploads, rebuilds, overwrites and draws, all as early as the order allows: nothing waits on the host
    /// but what the order makes wait. Returns whether each frame shows what was meant.
    pub fn run(&mut self) -> Result<Vec<bool>> {
        let copied_0 = self.upload(0, 1000, &[])?;
        let copied_1 = self.upload(1, 2_000_000, &[])?; // the ring is full until the first is copied
        self.build(0, 3, &[copied_0], 0)?;
        self.frame(0)?;
        self.build(1, 5, &[copied_1], 0)?; // reads its neighbour's tops, which the build before wrote
        self.build(0, 7, &[], 0)?; // another mask: rewrites what the frame reads
        self.frame(0)?;
        self.frame(1)?;
        let last_use = self.build(0, 9, &[], 0)?; // no frame shows it, but it reads the runs
        let copied_2 = self.upload(0, 77_000_000, &[last_use])?; // over what two frames may still read
        self.build(0, 11, &[copied_2], 0)?;
        self.frame(0)?;

        let mut right = Vec::new();
        for (frame, (point, meant)) in std::mem::take(&mut self.frames).into_iter().enumerate() {
            let mut bytes = vec![0; BYTES as usize];
            let buffer = self.readbacks[frame].clone();
            self.order.read(point, &buffer, 0, &mut bytes)?;
            self.touch(Agent::Host, &buffer, 0..BYTES, false);
            right.push(bytemuck::cast_slice::<u8, u32>(&bytes) == meant);
        }
        self.order.collect()?;
        Ok(right)
    }

    fn upload(&mut self, slot: usize, first: u32, last_use: &[SyncPoint]) -> Result<SyncPoint> {
        let runs: Vec<u32> = (first..).take(COUNT as usize).collect();
        let offset = loop {
            match self.ring.push(&mut self.order, bytemuck::cast_slice(&runs))? {
                Some(offset) => break offset,
                None => self.order.wait(self.ring.oldest().expect("a piece fits the empty ring"))?,
            }
        };
        self.meant[slot].runs = runs;
        let (ring, to) = (self.ring.buffer().clone(), self.slots[slot].runs.clone());
        self.touch(Agent::Host, &ring, offset..offset + BYTES, true);
        let mut commands = self.order.begin_copy("upload", last_use)?;
        commands.copy(&ring, &to, &[BufferCopy { from: offset, to: 0, size: BYTES }]);
        let copy = Agent::Device { queue: commands.queue(), stage: Stages::COPY };
        self.touch(copy, &ring, offset..offset + BYTES, false);
        self.touch(copy, &to, 0..BYTES, true);
        let point = self.order.submit(commands)?;
        self.ring.seal(point);
        Ok(point)
    }

    /// Derives from the slot's runs its tops, and from the tops of `neighbour` the rest.
    fn build(&mut self, slot: usize, mask: u32, copied: &[SyncPoint], neighbour: usize) -> Result<SyncPoint> {
        self.meant[slot].tops = mapped(&self.meant[slot].runs, mask);
        self.meant[slot].derived = mapped(&self.meant[neighbour].tops, mask);
        let Slot { runs, tops, derived } = self.slots[slot].clone();
        let neighbour = self.slots[neighbour].tops.clone();
        let mut commands = self.order.begin_build("build", copied)?;
        self.map(&mut commands, &runs, &tops, mask)?;
        self.order.next_pass(&mut commands);
        self.map(&mut commands, &neighbour, &derived, mask)?;
        self.order.submit(commands)
    }

    fn frame(&mut self, slot: usize) -> Result<SyncPoint> {
        let Slot { runs, derived, .. } = self.slots[slot].clone();
        let (traced, image) = (self.traced.clone(), self.image.clone());
        let (mut commands, turn) = self.order.begin_frame("frame")?;
        let meant = &self.meant[slot];
        let meant = match self.access {
            Access::StorageBuffer => {
                self.map(&mut commands, &derived, &traced, 1)?;
                mapped(&self.meant[slot].derived, 1)
            }
            Access::Address => {
                let meant = meant.runs.iter().zip(&meant.derived).map(|(r, d)| r ^ d).collect();
                let table = self.tables[turn].clone();
                table.write(0, bytemuck::bytes_of(&[runs.address(), derived.address()]));
                self.touch(Agent::Host, &table, 0..16, true);
                commands.bind(&self.gather);
                commands.push(&push(&[table.address(), traced.address()], &[COUNT]));
                commands.dispatch([COUNT / GROUP, 1, 1]);
                for buffer in [&table, &runs, &derived] {
                    self.pass(&mut commands, buffer, false);
                }
                self.pass(&mut commands, &traced, true);
                meant
            }
        };
        self.order.next_pass(&mut commands);
        self.map(&mut commands, &traced, &image, 1)?;
        let readback = self.readbacks[self.frames.len()].clone();
        let before = self.order.events().len();
        self.order
            .readback(&mut commands, &[(&image, &readback, BufferCopy { from: 0, to: 0, size: BYTES })]);
        // The copy lies between the two barriers of the readback, of which one may be left out.
        let copied = |event: &Event| matches!(event, Event::Barrier { edge: Edge::ReadbackAfterPass, .. });
        let at = before + usize::from(self.order.events().get(before).is_some_and(copied));
        let copy = Agent::Device { queue: commands.queue(), stage: Stages::COPY };
        self.touches.push((at, touch(copy, &image, 0..BYTES, false)));
        self.touches.push((at, touch(copy, &readback, 0..BYTES, true)));
        let point = self.order.submit(commands)?;
        self.frames.push((point, mapped(&meant, 1)));
        Ok(point)
    }

    /// One pass: `to` from `from`.
    fn map(&mut self, commands: &mut Commands, from: &Buffer, to: &Buffer, factor: u32) -> Result<()> {
        commands.bind(&self.map);
        if self.access == Access::StorageBuffer {
            commands.bind_buffers(&self.map.binding(&[from, to])?);
        }
        commands.push(&push(&[from.address(), to.address()], &[COUNT, SHIFT, factor]));
        commands.dispatch([COUNT / GROUP, 1, 1]);
        self.pass(commands, from, false);
        self.pass(commands, to, true);
        Ok(())
    }

    /// Notes what a dispatch touches, and keeps it.
    fn pass(&mut self, commands: &mut Commands, buffer: &Buffer, write: bool) {
        commands.keep(buffer.clone());
        let agent = Agent::Device { queue: commands.queue(), stage: Stages::COMPUTE_SHADER };
        self.touch(agent, buffer, 0..buffer.size(), write);
    }

    fn touch(&mut self, agent: Agent, buffer: &Buffer, bytes: Range<u64>, write: bool) {
        self.touches.push((self.order.events().len(), touch(agent, buffer, bytes, write)));
    }

    /// Everything that happened, in order.
    pub fn steps(&self) -> Vec<Step> {
        let mut touches = self.touches.iter().peekable();
        let mut steps = Vec::new();
        for (i, event) in self.order.events().iter().enumerate() {
            while let Some((_, touch)) = touches.next_if(|(before, _)| *before <= i) {
                steps.push(Step::Touch(touch.clone()));
            }
            steps.push(Step::Event(*event));
        }
        steps.extend(touches.map(|(_, touch)| Step::Touch(touch.clone())));
        steps
    }
}

fn touch(agent: Agent, buffer: &Buffer, bytes: Range<u64>, write: bool) -> Touch {
    Touch { agent, buffer: buffer.name().to_owned(), bytes, write }
}

/// Push constants: addresses, then numbers.
fn push(addresses: &[u64], numbers: &[u32]) -> Vec<u8> {
    [bytemuck::cast_slice(addresses), bytemuck::cast_slice(numbers)].concat()
}

/// What `map.comp` does.
fn mapped(from: &[u32], factor: u32) -> Vec<u32> {
    let at = |i| from[(i + SHIFT as usize) % COUNT as usize];
    (0..COUNT as usize).map(|i| u32::wrapping_mul(at(i), factor).wrapping_add(1)).collect()
}
