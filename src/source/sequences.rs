//! GPS times as LASzip keeps them: four interleaved time lines, each of which goes on by multiples of its last difference
//! (Isenburg 2013; `LASreadItemCompressed_GPSTIME11_v2`, and the layer of times of `LASreadItemCompressed_POINT14_v3`).
//!
//! `laz` (0.13) follows switches between them by recursion: 200 bytes of such switches overflow its stack, which takes the
//! process down.

use laz::{
    decoders::ArithmeticDecoder,
    decompressors::{IntegerDecompressor, IntegerDecompressorBuilder},
    models::{ArithmeticModel, ArithmeticModelBuilder},
};
use std::io::{self, Read};

/// Largest multiple of the last difference, and smallest.
const MULTI: i32 = 500;
const MULTI_MINUS: i32 = -10;
/// Symbols of multiples. Behind them: no change, where records say so here; a time in full; switches to another sequence.
const MULTIPLES: i32 = MULTI - MULTI_MINUS + 1;
/// The last of these.
const SWITCHES: i32 = 3;

/// Most switches in a record: an encoder looks for the fitting sequence first and needs one.
const MAX_SWITCHES: usize = 4;

/// One of the four time lines.
#[derive(Clone, Copy, Default)]
struct Sequence {
    /// The last time, as the bits of an f64.
    time: i64,
    diff: i32,
    /// Differences in a row that are far from `diff`.
    extremes: u32,
}

impl Sequence {
    /// Takes `diff` over after four extreme ones in a row.
    fn count_extreme(&mut self, diff: i32) {
        self.extremes += 1;
        if self.extremes > 3 {
            (self.diff, self.extremes) = (diff, 0);
        }
    }
}

/// The four of them.
pub(super) struct Sequences {
    multi: ArithmeticModel,
    zero_diff: ArithmeticModel,
    ints: IntegerDecompressor,
    of: [Sequence; 4],
    last: usize,
    next: usize,
    /// Symbols that say that a time is that of the record before: 1, or none.
    unchanged: i32,
}

impl Sequences {
    /// From the first record's time on, as the bits of an f64. `unchanged`: a symbol may say that a time is that of the record before.
    pub(super) fn new(time: i64, unchanged: bool) -> Sequences {
        let mut of = [Sequence::default(); 4];
        of[0].time = time;
        let unchanged = i32::from(unchanged);
        let model = |symbols: i32| ArithmeticModelBuilder::new((symbols + unchanged) as u32).build();
        Sequences {
            multi: model(MULTIPLES + 1 + SWITCHES),
            zero_diff: model(2 + SWITCHES),
            ints: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
            of,
            last: 0,
            next: 0,
            unchanged,
        }
    }

    /// The time of the next record, as the bits of an f64.
    pub(super) fn decode<R: Read>(&mut self, from: &mut ArithmeticDecoder<R>) -> io::Result<i64> {
        for _ in 0..=MAX_SWITCHES {
            if self.step(from)? {
                return Ok(self.of[self.last].time);
            }
        }
        Err(io::Error::new(io::ErrorKind::InvalidData, "GPS time switches between its sequences without end"))
    }

    /// Decodes one symbol and what belongs to it; `false` if it was a switch and the time is still to come.
    #[inline]
    fn step<R: Read>(&mut self, from: &mut ArithmeticDecoder<R>) -> io::Result<bool> {
        let sequence = &mut self.of[self.last];
        if sequence.diff == 0 {
            match from.decode_symbol(&mut self.zero_diff)? as i32 - self.unchanged {
                ..0 => {}
                0 => {
                    let diff = self.ints.decompress(from, 0, 0)?;
                    let time = sequence.time.wrapping_add(diff.into());
                    *sequence = Sequence { time, diff, extremes: 0 };
                }
                1 => self.start(from)?,
                switch => {
                    self.last = (self.last + switch as usize - 1) & 3;
                    return Ok(false);
                }
            }
            return Ok(true);
        }
        let multi = from.decode_symbol(&mut self.multi)? as i32;
        match multi - MULTIPLES - self.unchanged {
            _ if multi < MULTIPLES => {}
            ..0 => return Ok(true),
            0 => return self.start(from).map(|()| true),
            switch => {
                self.last = (self.last + switch as usize) & 3;
                return Ok(false);
            }
        }
        let (factor, context) = match multi {
            0 => (0, 7),
            1 => (1, 1),
            2..10 => (multi, 2),
            10..MULTI => (multi, 3),
            MULTI => (multi, 4),
            _ if MULTI - multi > MULTI_MINUS => (MULTI - multi, 5),
            _ => (MULTI_MINUS, 6),
        };
        let diff = self.ints.decompress(from, sequence.diff.wrapping_mul(factor), context)?;
        sequence.time = sequence.time.wrapping_add(diff.into());
        match context {
            1 => sequence.extremes = 0,
            4 | 6 | 7 => sequence.count_extreme(diff),
            _ => {}
        }
        Ok(true)
    }

    /// A time in full begins a sequence.
    fn start<R: Read>(&mut self, from: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        let high = self.ints.decompress(from, (self.of[self.last].time >> 32) as i32, 8)?;
        let time = i64::from(high) << 32 | i64::from(from.read_int()?);
        self.next = (self.next + 1) & 3;
        self.last = self.next;
        self.of[self.last] = Sequence { time, ..Sequence::default() };
        Ok(())
    }
}
