//! Files made to hurt: each is refused or read in part, and none takes the process down.

use lasray::coords::{Grid, HEIGHT_STEP};
use lasray::ingest::bins::{Bins, Budget};
use lasray::ingest::input::Input;
use lasray::ingest::workers::{ReadProgress, read_all};
use lasray::sample::{self, RgbDepth};
use lasray::section::Surface;
use lasray::source::placement::{Placement, PlacementOptions};
use lasray::source::{Decoder, LayerMemory, LidarFile};
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

/// Reads `file` into bins; gives the points that arrived and what was said.
fn read(file: LidarFile) -> (u64, Vec<String>) {
    let grid = Grid { base_cell: 1.0, coarsen: 0, anchor: [0, 0], height_step: HEIGHT_STEP };
    let everywhere = [i64::MIN / 2..i64::MAX / 2, i64::MIN / 2..i64::MAX / 2];
    let bins =
        Bins::new(Surface::Columns, grid, everywhere, Budget { host_bytes: 1 << 30, device_bytes: 1 << 30 });
    let progress = ReadProgress::default();
    let inputs = [Input { file, placement: Placement::default(), rgb: RgbDepth::None }];
    let errors = read_all(&inputs, &bins, 2, &LayerMemory::default(), &progress);
    (progress.points.into_inner(), errors.iter().map(ToString::to_string).collect())
}

#[test]
fn a_file_that_vanishes_or_changes_is_named_once() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("gone.laz");
    let bytes = crate::made::Made::new(3, crate::made::Packing::Fixed(50), 500).bytes();
    let write = || std::fs::write(&path, &bytes).unwrap();

    // Between the index and the first chunk.
    write();
    let file = LidarFile::open(&path).unwrap();
    assert_eq!(file.chunks.len(), 10);
    std::fs::remove_file(&path).unwrap();
    let (points, errors) = read(file);
    assert_eq!((points, errors.len()), (0, 1), "{errors:?}");
    assert!(errors[0].contains("gone.laz: cannot reopen: "), "{errors:?}");

    // It is there again, but shorter.
    write();
    let file = LidarFile::open(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let (points, errors) = read(file);
    assert_eq!((points, errors.len()), (0, 1), "{errors:?}");
    assert!(errors[0].contains("gone.laz: changed while it was read"), "{errors:?}");

    // While it is open: the first half is still there.
    write();
    let file = LidarFile::open(&path).unwrap();
    file.bytes.handle().unwrap();
    let half = file.chunks[5].byte_offset;
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(half).unwrap();
    let (points, errors) = read(file);
    assert!(points <= 250 && errors.len() == 1, "{points} {errors:?}");
    assert!(errors[0].contains("gone.laz: "), "{errors:?}");

    // Before the opening sample.
    write();
    let opened = sample::open_all(std::slice::from_ref(&path));
    std::fs::remove_file(&path).unwrap();
    let opened: Vec<_> = opened.into_iter().map(Result::unwrap).collect();
    let sample = sample::take(
        &opened,
        &PlacementOptions::default(),
        &sample::Asked::default(),
        &sample::SampleBudget::default(),
    );
    assert!(sample.problems.iter().any(|(_, e)| e.to_string().contains("gone.laz")), "{:?}", sample.problems);
}

/// A fault of this program while a chunk is read is that chunk's error; nothing waits for the thread.
#[test]
fn a_fault_of_the_program_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("fault.las");
    std::fs::write(&path, crate::made::Made::new(3, crate::made::Packing::Plain, 500).bytes()).unwrap();
    let mut file = LidarFile::open(&path).unwrap();
    file.header.record_len = 0;
    let (points, errors) = read(file);
    assert_eq!((points, errors.len()), (0, 1), "{errors:?}");
    assert!(errors[0].contains("fault.las: chunk 0 at byte "), "{errors:?}");
    assert!(errors[0].contains("a fault of the program: attempt to divide by zero"), "{errors:?}");
}
