//! GPS times of layered chunks (LASzip 3, point formats 6 to 10; `LASreadItemCompressed_POINT14_v3`).
//!
//! `laz` (0.13) follows switches between sequences of times by recursion: a few bytes of such switches overflow its stack,
//! which takes the process down. So it is given no layer of times, and they are decoded here, beside it: the first layer
//! (channel, returns, X, Y) says which records have another time than the one before of their scanner channel.

use super::{sequences::Sequences, stream::ByteStream};
use laz::{
    decoders::ArithmeticDecoder,
    decompressors::{IntegerDecompressor, IntegerDecompressorBuilder},
    models::{ArithmeticModel, ArithmeticModelBuilder},
};
use std::io;

/// Context of X and Y, by the number of returns and the number of the return.
const RETURNS: [[u8; 16]; 16] = [
    [0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5],
    [1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3],
    [2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3],
    [3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5],
];

/// Bits of the first symbol of a record.
const CHANNEL_CHANGES: u32 = 1 << 6;
const TIME_CHANGES: u32 = 1 << 4;
const COUNT_CHANGES: u32 = 1 << 2;

fn model(symbols: u32) -> ArithmeticModel {
    ArithmeticModelBuilder::new(symbols).build()
}

fn integers(contexts: u32) -> IntegerDecompressor {
    IntegerDecompressorBuilder::new().bits(32).contexts(contexts).build_initialized()
}

/// The median of about the last five values.
#[derive(Clone, Copy)]
struct Median {
    values: [i32; 5],
    high: bool,
}

impl Median {
    fn get(&self) -> i32 {
        self.values[2]
    }

    /// The values are in order; the highest and the lowest drop out in turn.
    fn add(&mut self, value: i32) {
        let v = &mut self.values;
        let middle = v[2];
        if self.high {
            if value < middle {
                let at = (0..2).find(|&k| value < v[k]).unwrap_or(2);
                v[at..].rotate_right(1);
                v[at] = value;
            } else {
                let at = if value < v[3] { 3 } else { 4 };
                v[at..].rotate_right(1);
                v[at] = value;
                self.high = false;
            }
        } else if middle < value {
            let at = (3..5).rev().find(|&k| v[k] < value).unwrap_or(2);
            v[..=at].rotate_left(1);
            v[at] = value;
        } else {
            let at = usize::from(v[1] < value);
            v[..=at].rotate_left(1);
            v[at] = value;
            self.high = true;
        }
    }
}

/// What is known of a scanner channel: its last record, and how its next is coded.
struct Channel {
    /// Number of the return, and of returns.
    number: usize,
    count: usize,
    has_new_time: bool,
    time: i64,
    changes: Vec<ArithmeticModel>,
    channels: ArithmeticModel,
    counts: [Option<ArithmeticModel>; 16],
    numbers: [Option<ArithmeticModel>; 16],
    numbers_of_pulse: ArithmeticModel,
    dx: IntegerDecompressor,
    dy: IntegerDecompressor,
    /// Of X and Y.
    medians: [[Median; 12]; 2],
    times: Sequences,
}

impl Channel {
    fn new(number: usize, count: usize, time: i64) -> Channel {
        Channel {
            number,
            count,
            has_new_time: false,
            time,
            changes: (0..8).map(|_| model(128)).collect(),
            channels: model(3),
            counts: Default::default(),
            numbers: Default::default(),
            numbers_of_pulse: model(13),
            dx: integers(2),
            dy: integers(22),
            medians: [[Median { values: [0; 5], high: true }; 12]; 2],
            times: Sequences::new(time, false),
        }
    }
}

/// The times of a chunk, record by record.
pub(super) struct Times<'f> {
    /// Layers of returns, X and Y, and of times; `None`: all records have the first one's.
    layers: Option<[ArithmeticDecoder<ByteStream<'f>>; 2]>,
    channels: [Option<Channel>; 4],
    current: usize,
    is_first: bool,
}

impl<'f> Times<'f> {
    /// `first`: the chunk's first record, raw; `layers`: that of returns, X and Y, and that of times, `None` where the latter is
    /// empty.
    pub fn new(first: &[u8], layers: Option<[ByteStream<'f>; 2]>) -> io::Result<Times<'f>> {
        let mut channels: [Option<Channel>; 4] = Default::default();
        let current = usize::from(first[15] >> 4 & 3);
        let mut time = [0; 8];
        time.copy_from_slice(&first[22..30]);
        let (number, count) = (usize::from(first[14] & 15), usize::from(first[14] >> 4));
        channels[current] = Some(Channel::new(number, count, i64::from_le_bytes(time)));
        // What is coded begins with the second record.
        let started = |stream| {
            let mut decoder = ArithmeticDecoder::new(stream);
            decoder.read_init_bytes().map(|()| decoder)
        };
        let layers = match layers {
            Some([layer, times]) => Some([started(layer)?, started(times)?]),
            None => None,
        };
        Ok(Times { layers, channels, current, is_first: true })
    }

    /// The time of the next record, as its bytes.
    pub fn next(&mut self) -> io::Result<[u8; 8]> {
        if !std::mem::take(&mut self.is_first) {
            self.decode()?;
        }
        Ok(self.channel().time.to_le_bytes())
    }

    fn channel(&mut self) -> &mut Channel {
        self.channels[self.current].as_mut().expect("the current channel has had a record")
    }

    fn decode(&mut self) -> io::Result<()> {
        let Times { layers: Some([layer, times]), channels, current, .. } = self else { return Ok(()) };
        let before = channels[*current].as_mut().expect("the current channel has had a record");
        let kind = usize::from(before.number == 1)
            + 2 * usize::from(before.number >= before.count)
            + 4 * usize::from(before.has_new_time);
        let changes = layer.decode_symbol(&mut before.changes[kind])?;
        if changes & CHANNEL_CHANGES != 0 {
            let other = layer.decode_symbol(&mut before.channels)?;
            let (number, count, time) = (before.number, before.count, before.time);
            *current = (*current + other as usize + 1) & 3;
            channels[*current].get_or_insert_with(|| Channel::new(number, count, time));
        }
        let of = channels[*current].as_mut().expect("made above, where there was none");
        of.has_new_time = changes & TIME_CHANGES != 0;
        if changes & COUNT_CHANGES != 0 {
            let counts = of.counts[of.count].get_or_insert_with(|| model(16));
            of.count = layer.decode_symbol(counts)? as usize & 15;
        }
        of.number = match changes & 3 {
            0 => of.number,
            1 => of.number + 1,
            2 => of.number + 15,
            _ if of.has_new_time => {
                layer.decode_symbol(of.numbers[of.number].get_or_insert_with(|| model(16)))? as usize
            }
            _ => of.number + layer.decode_symbol(&mut of.numbers_of_pulse)? as usize + 2,
        } & 15;
        // Where it lies is not asked for, but stands between.
        let context = usize::from(RETURNS[of.count][of.number]) << 1 | usize::from(of.has_new_time);
        let is_single = u32::from(of.count == 1);
        let [east, north] = &mut of.medians;
        let diff = of.dx.decompress(layer, east[context].get(), is_single)?;
        east[context].add(diff);
        let bits = if of.dx.k() < 20 { of.dx.k() & !1 } else { 20 };
        let diff = of.dy.decompress(layer, north[context].get(), is_single + bits)?;
        north[context].add(diff);
        if of.has_new_time {
            of.time = of.times.decode(times)?;
        }
        Ok(())
    }
}
