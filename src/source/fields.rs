//! Two fields of interleaved records that the `laz` crate (0.13) decodes wrongly.

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

/// GPS time, version 2 (LASzip, `LASreadItemCompressed_GPSTIME11_v2`; Isenburg 2013).
///
/// `laz` follows switches between sequences by recursion: 200 bytes of such switches overflow its stack,
/// which takes the process down.
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

/// R, G, B, version 1 (LASzip, `LASreadItemCompressed_RGB12_v1`).
///
/// `laz` ors a new upper byte into the old one, so 16-bit colours come out wrong and the coder derails.
pub(super) struct RgbV1 {
    changed: ArithmeticModel,
    ints: IntegerDecompressor,
    /// Bytes of the last colour as stored: R low, R high, G low, ...
    last: [u8; 6],
}

impl Default for RgbV1 {
    fn default() -> RgbV1 {
        RgbV1 {
            changed: ArithmeticModelBuilder::new(64).build(),
            ints: IntegerDecompressorBuilder::new().bits(8).contexts(6).build_initialized(),
            last: [0; 6],
        }
    }
}

impl<R: Read> FieldDecompressor<R> for RgbV1 {
    fn size_of_field(&self) -> usize {
        6
    }

    fn decompress_first(&mut self, src: &mut R, first: &mut [u8]) -> io::Result<()> {
        src.read_exact(&mut self.last)?;
        first.copy_from_slice(&self.last);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, out: &mut [u8]) -> io::Result<()> {
        let changed = decoder.decode_symbol(&mut self.changed)?;
        for (i, byte) in self.last.iter_mut().enumerate() {
            if changed >> i & 1 == 1 {
                *byte = self.ints.decompress(decoder, (*byte).into(), i as u32)? as u8;
            }
        }
        out.copy_from_slice(&self.last);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use laz::compressors::{IntegerCompressor, IntegerCompressorBuilder};
    use laz::encoders::ArithmeticEncoder;
    use laz::record::{
        FieldCompressor, RecordCompressor, RecordDecompressor, SequentialPointRecordCompressor,
        SequentialPointRecordDecompressor,
    };
    use proptest::prelude::*;
    use std::io::Write;

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

    /// The other direction of [`RgbV1`]; `laz`'s own takes the wrong model for the upper byte of B.
    struct EncodeRgbV1 {
        changed: ArithmeticModel,
        ints: IntegerCompressor,
        last: [u8; 6],
    }

    impl<W: Write> FieldCompressor<W> for EncodeRgbV1 {
        fn size_of_field(&self) -> usize {
            6
        }

        fn compress_first(&mut self, dst: &mut W, buf: &[u8]) -> io::Result<()> {
            self.last.copy_from_slice(buf);
            dst.write_all(buf)
        }

        fn compress_with(&mut self, encoder: &mut ArithmeticEncoder<W>, buf: &[u8]) -> io::Result<()> {
            let changed = (0..6).map(|i| u32::from(buf[i] != self.last[i]) << i).sum::<u32>();
            encoder.encode_symbol(&mut self.changed, changed)?;
            for i in (0..6).filter(|i| changed >> i & 1 == 1) {
                self.ints.compress(encoder, self.last[i].into(), buf[i].into(), i as u32)?;
            }
            self.last.copy_from_slice(buf);
            Ok(())
        }
    }

    proptest! {
        #[test]
        fn rgb_v1_is_what_was_encoded(colors in prop::collection::vec(prop::array::uniform6(any::<u8>()), 1..300)) {
            let mut encoded = Vec::new();
            let mut compressor = SequentialPointRecordCompressor::new(&mut encoded);
            compressor.add_field_compressor(EncodeRgbV1 {
                changed: ArithmeticModelBuilder::new(64).with_compression(true).build(),
                ints: IntegerCompressorBuilder::new().bits(8).contexts(6).build_initialized(),
                last: [0; 6],
            });
            colors.iter().for_each(|c| compressor.compress_next(c).unwrap());
            compressor.done().unwrap();
            drop(compressor);
            let mut decompressor = SequentialPointRecordDecompressor::new(encoded.as_slice());
            decompressor.add_field_decompressor(RgbV1::default());
            for color in colors {
                let mut out = [0; 6];
                decompressor.decompress_next(&mut out).unwrap();
                prop_assert_eq!(out, color);
            }
        }

        #[test]
        fn gps_time_equals_what_laz_encodes(steps in prop::collection::vec((step(), 1usize..6), 1..200), lines in 1usize..6) {
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
