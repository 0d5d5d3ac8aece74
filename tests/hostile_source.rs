//! Files made to hurt: each is refused or read in part, and none takes the process down.

use lasray::source::{Decoder, LidarFile};
use laz::{
    LazVlrBuilder,
    encoders::ArithmeticEncoder,
    models::{ArithmeticModel, ArithmeticModelBuilder},
    record::{FieldCompressor, RecordCompressor, SequentialPointRecordCompressor},
};
use std::io::Write;

/// A GPS time coder that switches between its four sequences again and again within one record.
struct EndlessSwitch {
    model: ArithmeticModel,
    switches: usize,
}

impl<W: Write> FieldCompressor<W> for EndlessSwitch {
    fn size_of_field(&self) -> usize {
        8
    }

    fn compress_first(&mut self, dst: &mut W, buf: &[u8]) -> std::io::Result<()> {
        dst.write_all(buf)
    }

    fn compress_with(&mut self, encoder: &mut ArithmeticEncoder<W>, _: &[u8]) -> std::io::Result<()> {
        (0..self.switches).try_for_each(|_| encoder.encode_symbol(&mut self.model, 3))
    }
}

/// A LAS 1.2 file of format 1 (LAZ) around one compressed chunk.
fn laz_file(chunk: &[u8], points: u32) -> Vec<u8> {
    let vlr = LazVlrBuilder::default().with_point_format(1, 0).unwrap().build();
    let mut payload = Vec::new();
    vlr.write_to(&mut payload).unwrap();
    let mut raw = las::raw::Header {
        version: las::Version::new(1, 2),
        header_size: 227,
        offset_to_point_data: 227 + 54 + payload.len() as u32,
        number_of_variable_length_records: 1,
        point_data_record_format: 129,
        point_data_record_length: 28,
        number_of_point_records: points,
        ..Default::default()
    };
    (raw.x_scale_factor, raw.y_scale_factor, raw.z_scale_factor) = (0.01, 0.01, 0.01);
    let mut file = Vec::new();
    raw.write_to(&mut file).unwrap();
    let mut head = [0u8; 54];
    head[2..16].copy_from_slice(b"laszip encoded");
    head[18..20].copy_from_slice(&22204u16.to_le_bytes());
    head[20..22].copy_from_slice(&(payload.len() as u16).to_le_bytes());
    file.extend(head);
    file.extend(payload);
    file.extend((-1i64).to_le_bytes());
    file.extend(chunk);
    file
}

#[test]
fn endless_gps_time_switches_do_not_overflow_the_stack() {
    let mut chunk = Vec::new();
    let mut compressor = SequentialPointRecordCompressor::new(&mut chunk);
    compressor.add_field_compressor(laz::las::v2::LasPoint0Compressor::default());
    let model = ArithmeticModelBuilder::new(6).with_compression(true).build();
    compressor.add_field_compressor(EndlessSwitch { model, switches: 3_000_000 });
    compressor.compress_next(&[0; 28]).unwrap();
    compressor.compress_next(&[0; 28]).unwrap();
    compressor.done().unwrap();
    drop(compressor);
    assert!(chunk.len() < 1000, "{}", chunk.len());
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("switch.laz");
    std::fs::write(&path, laz_file(&chunk, 2)).unwrap();
    let file = LidarFile::open(&path).unwrap();
    let mut points = 0;
    let result = Decoder::default().decode(&file, &file.chunks[0], 0..u64::MAX, &mut |b| points += b.len());
    let error = result.unwrap_err().to_string();
    assert!(error.contains("switch.laz: chunk 0 at byte 335: GPS time switches"), "{error}");
    assert_eq!(points, 0);
}
