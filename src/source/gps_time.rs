//! GPS time of LASzip's formats 1 and 3 to 5, version 2 (LASzip, `GPSTIME11` v2; Isenburg 2013).
//!
//! Here only because `laz` follows switches between sequences by recursion: 200 bytes of such switches
//! overflow its stack, which takes the process down.

use laz::{
    decoders::ArithmeticDecoder,
    decompressors::{IntegerDecompressor, IntegerDecompressorBuilder},
    models::{ArithmeticModel, ArithmeticModelBuilder},
    record::FieldDecompressor,
};
use std::io::{self, Read};

/// Largest multiple of the last difference, and smallest.
const MULTI: i32 = 500;
const MULTI_MINUS: i32 = -10;
/// Symbols beyond the multiples: no change; a time in full; switches to another sequence.
const UNCHANGED: i32 = MULTI - MULTI_MINUS + 1;
const FULL: i32 = UNCHANGED + 1;
const SYMBOLS: u32 = FULL as u32 + 4;

/// Most switches in a record: an encoder looks for the fitting sequence first and needs one.
const MAX_SWITCHES: usize = 4;

/// One of the four interleaved time lines.
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

/// Decodes the field; a drop-in for `laz::las::v2::GpsTimeDecompressor`.
pub(super) struct GpsTime {
    multi: ArithmeticModel,
    zero_diff: ArithmeticModel,
    ints: IntegerDecompressor,
    sequences: [Sequence; 4],
    last: usize,
    next: usize,
}

impl Default for GpsTime {
    fn default() -> GpsTime {
        GpsTime {
            multi: ArithmeticModelBuilder::new(SYMBOLS).build(),
            zero_diff: ArithmeticModelBuilder::new(6).build(),
            ints: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
            sequences: [Sequence::default(); 4],
            last: 0,
            next: 0,
        }
    }
}

impl GpsTime {
    /// Decodes one symbol and what belongs to it; `false` if it was a switch and the time is still to come.
    #[inline]
    fn step<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<bool> {
        let sequence = &mut self.sequences[self.last];
        if sequence.diff == 0 {
            match decoder.decode_symbol(&mut self.zero_diff)? {
                0 => {}
                1 => {
                    let diff = self.ints.decompress(decoder, 0, 0)?;
                    let time = sequence.time.wrapping_add(diff.into());
                    *sequence = Sequence { time, diff, extremes: 0 };
                }
                2 => self.start_sequence(decoder)?,
                switch => {
                    self.last = (self.last + switch as usize - 2) & 3;
                    return Ok(false);
                }
            }
            return Ok(true);
        }
        let multi = decoder.decode_symbol(&mut self.multi)? as i32;
        if multi == UNCHANGED {
            return Ok(true);
        }
        if multi == FULL {
            return self.start_sequence(decoder).map(|()| true);
        }
        if multi > FULL {
            self.last = (self.last + (multi - FULL) as usize) & 3;
            return Ok(false);
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
        let diff = self.ints.decompress(decoder, sequence.diff.wrapping_mul(factor), context)?;
        sequence.time = sequence.time.wrapping_add(diff.into());
        match context {
            1 => sequence.extremes = 0,
            4 | 6 | 7 => sequence.count_extreme(diff),
            _ => {}
        }
        Ok(true)
    }

    /// A time in full begins a sequence.
    fn start_sequence<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        let high = self.ints.decompress(decoder, (self.sequences[self.last].time >> 32) as i32, 8)?;
        let time = i64::from(high) << 32 | i64::from(decoder.read_int()?);
        self.next = (self.next + 1) & 3;
        self.last = self.next;
        self.sequences[self.last] = Sequence { time, ..Sequence::default() };
        Ok(())
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTime {
    fn size_of_field(&self) -> usize {
        8
    }

    fn decompress_first(&mut self, src: &mut R, first: &mut [u8]) -> io::Result<()> {
        let mut raw = [0; 8];
        src.read_exact(&mut raw)?;
        self.sequences[0].time = i64::from_le_bytes(raw);
        first.copy_from_slice(&raw);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, out: &mut [u8]) -> io::Result<()> {
        for _ in 0..=MAX_SWITCHES {
            if self.step(decoder)? {
                out.copy_from_slice(&self.sequences[self.last].time.to_le_bytes());
                return Ok(());
            }
        }
        Err(io::Error::new(io::ErrorKind::InvalidData, "GPS time switches between its sequences without end"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use laz::record::{
        RecordCompressor, RecordDecompressor, SequentialPointRecordCompressor,
        SequentialPointRecordDecompressor,
    };
    use proptest::prelude::*;

    /// Steps that make an encoder use every symbol.
    fn step() -> impl Strategy<Value = i64> {
        prop_oneof![
            Just(0),
            Just(1_000),
            1i64..600_000,
            -20_000i64..0,
            any::<i32>().prop_map(i64::from),
            any::<i64>(),
        ]
    }

    proptest! {
        #[test]
        fn equals_the_laz_crate(steps in prop::collection::vec((step(), 1usize..6), 1..200), lines in 1usize..6) {
            let mut times = vec![0i64; lines];
            let mut encoded = Vec::new();
            let mut written = Vec::new();
            let mut compressor = SequentialPointRecordCompressor::new(&mut encoded);
            compressor.add_field_compressor(laz::las::v2::GpsTimeCompressor::default());
            for (i, &(step, repeats)) in steps.iter().enumerate() {
                for _ in 0..repeats {
                    let line = &mut times[i % lines];
                    *line = line.wrapping_add(step);
                    compressor.compress_next(&line.to_le_bytes()).unwrap();
                    written.push(*line);
                }
            }
            compressor.done().unwrap();
            drop(compressor);
            let mut decompressor = SequentialPointRecordDecompressor::new(encoded.as_slice());
            decompressor.add_field_decompressor(GpsTime::default());
            for time in written {
                let mut out = [0; 8];
                decompressor.decompress_next(&mut out).unwrap();
                prop_assert_eq!(i64::from_le_bytes(out), time);
            }
        }
    }
}
