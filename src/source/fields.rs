//! Two fields of interleaved records that the `laz` crate (0.13) decodes wrongly.

use super::sequences::Sequences;
use laz::{
    decoders::ArithmeticDecoder,
    decompressors::{IntegerDecompressor, IntegerDecompressorBuilder},
    models::{ArithmeticModel, ArithmeticModelBuilder},
    record::FieldDecompressor,
};
use std::io::{self, Read};

/// GPS time, version 2 (LASzip, `LASreadItemCompressed_GPSTIME11_v2`; Isenburg 2013).
pub(super) struct GpsTime(Sequences);

impl Default for GpsTime {
    fn default() -> GpsTime {
        GpsTime(Sequences::new(0, true))
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTime {
    fn size_of_field(&self) -> usize {
        8
    }

    fn decompress_first(&mut self, src: &mut R, first: &mut [u8]) -> io::Result<()> {
        let mut raw = [0; 8];
        src.read_exact(&mut raw)?;
        self.0 = Sequences::new(i64::from_le_bytes(raw), true);
        first.copy_from_slice(&raw);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, out: &mut [u8]) -> io::Result<()> {
        out.copy_from_slice(&self.0.decode(decoder)?.to_le_bytes());
        Ok(())
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
