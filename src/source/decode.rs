//! Chunks to columns.

use super::{
    BLOCK_RECORDS, Chunk, Fields, FileHeader, LidarFile, OpenFile, PointBlock, SourceError,
    contain::contain,
    fields::{GpsTime, RgbV1},
    kept_apart::KeptApart,
    laszip::{Compressor, Laszip},
    layers::{ChunkLayers, WantedLayers},
    stream::{ByteStream, Splice, source_error},
    times::Times,
};
use laz::{
    LazItem, LazItemType,
    las::{v1, v2, v3, v4},
    record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor},
};
use std::{
    io::{self, Cursor},
    ops::Range,
    sync::{Arc, Condvar, Mutex, PoisonError},
};

/// Bytes of raw records that are read and taken apart at a time: stays in the second-level cache.
const RAW_BYTES: usize = 512 << 10;

/// Turns chunks into blocks of columns; one a worker thread, its buffers are reused.
#[derive(Debug)]
pub struct Decoder {
    raw: Vec<u8>,
    input: Vec<u8>,
    block: PointBlock,
    layers: LayerMemory,
    all_layers: bool,
    fields: Fields,
}

/// Memory that decoders share for the layers of the chunks that they are at. One that finds too little free waits for
/// the others; what needs more than there is in all is refused.
#[derive(Clone, Debug)]
pub struct LayerMemory(Arc<Layers>);

#[derive(Debug)]
struct Layers {
    most: u64,
    held: Mutex<u64>,
    /// Those who wait do so one after the other, so that a large chunk is not overtaken for ever.
    turn: Mutex<()>,
    freed: Condvar,
}

/// A share of [`LayerMemory`], given back when it is dropped.
struct HeldLayers<'a> {
    layers: &'a Layers,
    bytes: u64,
}

impl LayerMemory {
    /// So many bytes.
    pub fn new(most: u64) -> LayerMemory {
        LayerMemory(Arc::new(Layers {
            most,
            held: Mutex::new(0),
            turn: Mutex::new(()),
            freed: Condvar::new(),
        }))
    }

    /// Bytes that are in use.
    pub fn held(&self) -> u64 {
        *self.0.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes `bytes`, which are not more than there are: waits until they are free.
    fn take(&self, bytes: u64) -> HeldLayers<'_> {
        let layers = &*self.0;
        let _turn = layers.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let held = layers.held.lock().unwrap_or_else(PoisonError::into_inner);
        let is_full = |held: &mut u64| *held + bytes > layers.most;
        let mut held = layers.freed.wait_while(held, is_full).unwrap_or_else(PoisonError::into_inner);
        *held += bytes;
        HeldLayers { layers, bytes }
    }
}

impl Drop for HeldLayers<'_> {
    fn drop(&mut self) {
        *self.layers.held.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        self.layers.freed.notify_all();
    }
}

impl Default for Decoder {
    fn default() -> Decoder {
        Decoder::sharing(&LayerMemory::default())
    }
}

impl Default for LayerMemory {
    fn default() -> LayerMemory {
        LayerMemory::new(512 << 20)
    }
}

impl Decoder {
    /// A decoder that refuses layered chunks with more than `layer_limit` bytes of layers: those are
    /// decoded in memory, everything else as a stream.
    pub fn new(layer_limit: u64) -> Decoder {
        Decoder::sharing(&LayerMemory::new(layer_limit))
    }

    /// The same of decoders that share memory for layers.
    pub fn sharing(layers: &LayerMemory) -> Decoder {
        let (raw, input, block) = Default::default();
        Decoder { raw, input, block, layers: layers.clone(), all_layers: false, fields: Fields::default() }
    }

    /// The same decoder, but one that reads and decodes layers too that no [`PointBlock`] stores: what skipping them
    /// saves is measured against it.
    pub fn with_all_layers(self) -> Decoder {
        Decoder { all_layers: true, ..self }
    }

    /// Blocks have these fields from now on, besides those that pictures always need.
    pub fn set_fields(&mut self, fields: Fields) {
        self.fields = fields;
    }

    /// What is decoded of a layered chunk of `header`'s format.
    fn wanted(&self, header: &FileHeader) -> WantedLayers {
        WantedLayers { rgb: RecordLayout::of(header).rgb.is_some(), fields: self.fields }
    }

    /// Bytes of `chunk` that decoding reads: without the layers that no [`PointBlock`] stores.
    pub fn bytes_read(&self, file: &LidarFile, chunk: &Chunk) -> Result<u64, SourceError> {
        let layered = file.laszip.as_ref().is_some_and(|l| l.compressor == Compressor::Layered);
        if !layered || self.all_layers {
            return Ok(chunk.byte_len);
        }
        let layers =
            ChunkLayers::read(&file.bytes.handle()?, &file.header, chunk.byte_offset, chunk.byte_len)?
                .map_err(|reason| damage(file, chunk, &(0..chunk.records), 0, reason))?;
        Ok(layers.head_len() + layers.needed_bytes(self.wanted(&file.header)))
    }

    /// Hands the points `records` (counted from the chunk's first, clamped to what it holds) of `chunk` to
    /// `sink`, in order, in blocks of at most [`BLOCK_RECORDS`]. `chunk` is one of `file.chunks`.
    /// LAS starts reading at the first of them; LAZ decodes all before it too.
    ///
    /// On damage, the points before it have been handed out; the error says how many. LAZ has no
    /// checksums: what comes before the place where the damage shows may be wrong as well, so the block in
    /// which it shows is dropped, except where the file merely ends.
    pub fn decode(
        &mut self,
        file: &LidarFile,
        chunk: &Chunk,
        records: Range<u64>,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let end = records.end.min(chunk.records);
        let wanted = records.start.min(end)..end;
        match &file.laszip {
            _ if wanted.is_empty() => Ok(()),
            None => self.decode_las(file, chunk, wanted, sink),
            Some(laszip) if laszip.compressor == Compressor::Layered => {
                self.decode_layered(file, laszip, chunk, wanted, sink)
            }
            Some(laszip) => self.decode_sequential(file, laszip, chunk, wanted, sink),
        }
    }

    /// Of how many chunks [`Decoder::first_points`] takes one.
    pub fn stride_of_firsts(file: &LidarFile, most: usize) -> usize {
        file.chunks.len().div_ceil(most.clamp(1, BLOCK_RECORDS)).max(1)
    }

    /// The first points of at most `most` chunks (at most [`BLOCK_RECORDS`]) at an even stride, in file
    /// order: LAZ stores them raw, so nothing is decompressed. The block's `first_record` means nothing.
    pub fn first_points(&mut self, file: &LidarFile, most: usize) -> Result<&PointBlock, SourceError> {
        let layout = RecordLayout::of(&file.header);
        let stride = Decoder::stride_of_firsts(file, most);
        let handle = file.bytes.handle()?;
        // Records may be 64 KiB long: only their heads are kept.
        let head = layout.head();
        self.raw.clear();
        for chunk in file.chunks.iter().step_by(stride) {
            let at = self.raw.len();
            self.raw.resize(at + head.len, 0);
            handle.read_exact_at(&mut self.raw[at..], chunk.byte_offset)?;
        }
        self.block.first_record = 0;
        head.extract(&self.raw, self.fields, &mut self.block);
        Ok(&self.block)
    }

    /// `of_chunk` records at an even stride of every chunk of an uncompressed file, in blocks, in file order. A block's
    /// `first_record` means nothing.
    pub fn sparse_records(
        &mut self,
        file: &LidarFile,
        of_chunk: u64,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let layout = RecordLayout::of(&file.header);
        let handle = file.bytes.handle()?;
        let head = layout.head();
        self.block.first_record = 0;
        for chunks in file.chunks.chunks((BLOCK_RECORDS / of_chunk.max(1) as usize).max(1)) {
            self.raw.clear();
            for chunk in chunks {
                let wanted = of_chunk.min(chunk.records);
                for k in 0..wanted {
                    let at = self.raw.len();
                    self.raw.resize(at + head.len, 0);
                    let record = chunk.records * k / wanted;
                    let offset = chunk.byte_offset + record * layout.len as u64;
                    handle.read_exact_at(&mut self.raw[at..], offset)?;
                }
            }
            head.extract(&self.raw, self.fields, &mut self.block);
            sink(&self.block);
        }
        Ok(())
    }

    fn decode_las(
        &mut self,
        file: &LidarFile,
        chunk: &Chunk,
        wanted: Range<u64>,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let handle = file.bytes.handle()?;
        let layout = RecordLayout::of(&file.header);
        let run = layout.records_in(RAW_BYTES);
        let mut next = wanted.start;
        while next < wanted.end {
            let n = run.min(wanted.end - next);
            self.raw.resize(n as usize * layout.len, 0);
            handle.read_exact_at(&mut self.raw, chunk.byte_offset + next * layout.len as u64)?;
            self.emit(layout, chunk, next, sink);
            next += n;
        }
        Ok(())
    }

    fn decode_sequential(
        &mut self,
        file: &LidarFile,
        laszip: &Laszip,
        chunk: &Chunk,
        wanted: Range<u64>,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let bytes = chunk.byte_offset..chunk.byte_offset + chunk.byte_len;
        let stream = ByteStream::new(file.bytes.handle()?, std::mem::take(&mut self.input), bytes);
        let every = match laszip.compressor {
            Compressor::PointWise => None,
            _ => laszip.chunk_size,
        };
        let mut records = contain(|| Sequential::new(stream, &laszip.items, every))
            .map_err(|reason| damage(file, chunk, &wanted, 0, reason))?;
        let result =
            self.decode_records(file, RecordLayout::of(&file.header), chunk, wanted, &mut records, sink);
        self.input = records.inner.into_inner().into_buf();
        result
    }

    fn decode_layered(
        &mut self,
        file: &LidarFile,
        laszip: &Laszip,
        chunk: &Chunk,
        wanted: Range<u64>,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let bad = |reason| damage(file, chunk, &wanted, 0, reason);
        let handle = file.bytes.handle()?;
        let layers =
            ChunkLayers::read(&handle, &file.header, chunk.byte_offset, chunk.byte_len)?.map_err(bad)?;
        let (layout, needed) = if self.all_layers {
            (RecordLayout::of(&file.header), layers.byte_len())
        } else {
            let layout = RecordLayout::of_layers(&file.header);
            (layout, layers.needed_bytes(self.wanted(&file.header)))
        };
        let memory = self.layers.clone();
        if needed > memory.0.most {
            return Err(bad(format!(
                "its layers need {needed} bytes of memory, {} are allowed",
                memory.0.most
            )));
        }
        let which = self.wanted(&file.header);
        // A few points at the start are in the beginnings of the layers. Where they are not, all is read.
        if !self.all_layers
            && wanted.start == 0
            && wanted.end < layers.records / 4
            && wanted.end <= layout.records_in(RAW_BYTES)
        {
            let ranges = layers.wanted_of_first(which, wanted.end);
            self.raw.resize(wanted.end as usize * layout.len, 0);
            let raw = &mut self.raw;
            let decoded = contain(|| {
                let mut records = Layered::new(handle.clone(), &laszip.items, layout, &layers, ranges);
                records.add_times(&handle, &layers, which)?;
                records.decode(raw, layout.len)
            });
            if let Ok(Ok(())) = decoded {
                self.emit(layout, chunk, 0, sink);
                return Ok(());
            }
        }
        let _held = memory.take(needed);
        let mut records = contain(|| match self.all_layers {
            true => Layered::all(handle.clone(), &laszip.items, &layers),
            false => Layered::new(handle.clone(), &laszip.items, layout, &layers, layers.wanted(which)),
        })
        .map_err(bad)?;
        if !self.all_layers {
            let added = contain(|| records.add_times(&handle, &layers, which));
            added.and_then(|added| added.map_err(|stop| stop.error.to_string())).map_err(bad)?;
        }
        let held = wanted.start.min(layers.records)..wanted.end.min(layers.records);
        self.decode_records(file, layout, chunk, held.clone(), &mut records, sink)?;
        if held.end < wanted.end {
            let reason = format!("it says that it has {} points", layers.records);
            return Err(damage(file, chunk, &wanted, held.end - held.start, reason));
        }
        Ok(())
    }

    fn decode_records(
        &mut self,
        file: &LidarFile,
        layout: RecordLayout,
        chunk: &Chunk,
        wanted: Range<u64>,
        records: &mut dyn Records,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let run = layout.records_in(RAW_BYTES);
        let mut next = 0;
        while next < wanted.end {
            // A run ends where the wanted points begin, so that each is handed out whole or not at all.
            let until = if next < wanted.start { wanted.start } else { wanted.end };
            let n = run.min(until - next);
            self.raw.resize(n as usize * layout.len, 0);
            let raw = &mut self.raw;
            let mut end = None;
            let sound = match contain(|| records.decode(raw, layout.len)) {
                Ok(Ok(())) => n,
                Ok(Err(stop)) => {
                    let error = match source_error(stop.error) {
                        Ok(error) => return Err(error),
                        Err(error) => error,
                    };
                    let cut = error.kind() == io::ErrorKind::UnexpectedEof;
                    let at_end = chunk.byte_offset + chunk.byte_len == file.bytes.len();
                    let open_end = file.open_end && chunk.index + 1 == file.chunks.len() as u64;
                    end = Some(if cut && open_end { Ok(()) } else { Err(error.to_string()) });
                    if cut && (at_end || open_end) { stop.sound as u64 } else { 0 }
                }
                Err(panic) => {
                    end = Some(Err(panic));
                    0
                }
            };
            if next >= wanted.start && sound > 0 {
                self.raw.truncate(sound as usize * layout.len);
                self.emit(layout, chunk, next, sink);
            }
            next += sound;
            if let Some(end) = end {
                let read = next.saturating_sub(wanted.start);
                return end.map_err(|reason| damage(file, chunk, &wanted, read, reason));
            }
        }
        Ok(())
    }

    /// Hands out the records in `raw`, the first of which is record `next` of `chunk`.
    fn emit(&mut self, layout: RecordLayout, chunk: &Chunk, next: u64, sink: &mut dyn FnMut(&PointBlock)) {
        self.block.first_record = chunk.first_record + next;
        layout.extract(&self.raw, self.fields, &mut self.block);
        sink(&self.block);
    }
}

fn damage(file: &LidarFile, chunk: &Chunk, wanted: &Range<u64>, read: u64, reason: String) -> SourceError {
    SourceError::Chunk {
        path: file.path().to_owned(),
        chunk: chunk.index,
        offset: chunk.byte_offset,
        read,
        records: wanted.end - wanted.start,
        reason,
    }
}

/// Where decoding ended early.
struct Stop {
    error: io::Error,
    /// Records that are complete beyond doubt if the data were merely cut.
    sound: usize,
}

/// A source of raw records.
trait Records {
    /// Fills `raw` with whole records of `len` bytes.
    fn decode(&mut self, raw: &mut [u8], len: usize) -> Result<(), Stop>;
}

/// Interleaved records, one chunk behind the other.
struct Sequential<'f, 'i> {
    inner: SequentialPointRecordDecompressor<'f, ByteStream<'f>>,
    items: &'i [LazItem],
    /// The coder restarts after so many records.
    every: Option<u64>,
    /// Records since it started.
    since: u64,
}

impl<'f, 'i> Sequential<'f, 'i> {
    fn new(stream: ByteStream<'f>, items: &'i [LazItem], every: Option<u64>) -> Self {
        let inner = SequentialPointRecordDecompressor::new(stream);
        let mut records = Sequential { inner, items, every, since: 0 };
        records.add_fields();
        records
    }

    /// `items` have been checked to be of versions 1 and 2 and of these types.
    fn add_fields(&mut self) {
        use LazItemType::{Byte, Point10, RGB12, WavePacket13};
        let to = &mut self.inner;
        for item in self.items {
            match (item.item_type(), item.version()) {
                (Point10, 1) => to.add_field_decompressor(v1::LasPoint0Decompressor::default()),
                (Point10, _) => to.add_field_decompressor(v2::LasPoint0Decompressor::default()),
                (LazItemType::GpsTime, 1) => to.add_field_decompressor(v1::LasGpsTimeDecompressor::default()),
                (LazItemType::GpsTime, _) => to.add_field_decompressor(GpsTime::default()),
                (RGB12, 1) => to.add_field_decompressor(RgbV1::default()),
                (RGB12, _) => to.add_field_decompressor(v2::LasRGBDecompressor::default()),
                (WavePacket13, _) => to.add_field_decompressor(v1::LasWavepacketDecompressor::default()),
                (Byte(n), 1) => to.add_field_decompressor(v1::LasExtraByteDecompressor::new(n.into())),
                (Byte(n), _) => to.add_field_decompressor(v2::LasExtraByteDecompressor::new(n.into())),
                (other, version) => unreachable!("item {other:?} of version {version} passed the checks"),
            }
        }
    }
}

impl Records for Sequential<'_, '_> {
    fn decode(&mut self, raw: &mut [u8], len: usize) -> Result<(), Stop> {
        let mut sound = 0;
        for (i, record) in raw.chunks_exact_mut(len).enumerate() {
            if Some(self.since) == self.every {
                self.inner.reset();
                self.add_fields();
                self.since = 0;
            }
            // The coder looks four bytes ahead: once it has taken the last one, records still come out
            // that may be nothing but its padding.
            if !self.inner.get().exhausted() {
                sound = i;
            }
            self.inner.decompress_next(record).map_err(|error| Stop { error, sound })?;
            self.since += 1;
        }
        Ok(())
    }
}

/// The records of one layered chunk, without the layers that are not asked for.
struct Layered<'f> {
    inner: LayeredPointRecordDecompressor<'f, Splice<'f>>,
    /// Where they are asked for.
    times: Option<Times<'f>>,
}

impl<'f> Layered<'f> {
    /// `items` have been checked to be of versions 3 and 4; `ranges`: where the wanted layers lie.
    fn new(
        file: OpenFile<'f>,
        items: &[LazItem],
        layout: RecordLayout,
        layers: &ChunkLayers,
        ranges: Vec<Range<u64>>,
    ) -> Self {
        // The decoder reads: first record, count, sizes, layers. It is given a chunk whose other layers are
        // empty, and which ends after the colours.
        let mut front = layers.first[..layout.len].to_vec();
        front.extend((layers.records as u32).to_le_bytes());
        front.extend(ranges.iter().flat_map(|range| ((range.end - range.start) as u32).to_le_bytes()));
        let mut inner =
            LayeredPointRecordDecompressor::new(Splice { front: Cursor::new(front), file, ranges });
        for item in items {
            match (item.item_type(), item.version()) {
                (LazItemType::Point14, 3) => {
                    inner.add_field_decompressor(v3::LasPoint6Decompressor::default())
                }
                (LazItemType::Point14, _) => {
                    inner.add_field_decompressor(v4::LasPoint6Decompressor::default())
                }
                (LazItemType::RGB14 | LazItemType::RGBNIR14, 3) => {
                    inner.add_field_decompressor(v3::LasRGBDecompressor::default());
                }
                (LazItemType::RGB14 | LazItemType::RGBNIR14, _) => {
                    inner.add_field_decompressor(v4::LasRGBDecompressor::default());
                }
                _ => {}
            }
        }
        Layered { inner, times: None }
    }

    /// Records have their times, where those are wanted.
    fn add_times(
        &mut self,
        file: &OpenFile<'f>,
        layers: &ChunkLayers,
        wanted: WantedLayers,
    ) -> Result<(), Stop> {
        if wanted.fields.gps_time {
            let ranges = layers.of_times();
            let streams = || ranges.clone().map(|range| ByteStream::new(file.clone(), Vec::new(), range));
            let times = Times::new(&layers.first, (!ranges[1].is_empty()).then(streams));
            self.times = Some(times.map_err(|error| Stop { error, sound: 0 })?);
        }
        Ok(())
    }

    /// The same with every layer; `items` have been checked to be of versions 3 and 4.
    fn all(file: OpenFile<'f>, items: &[LazItem], layers: &ChunkLayers) -> Self {
        use LazItemType::{Byte14, Point14, RGB14, RGBNIR14, WavePacket14};
        let mut front = layers.first.clone();
        front.extend((layers.records as u32).to_le_bytes());
        front.extend(layers.sizes().iter().flat_map(|s| s.to_le_bytes()));
        let ranges = vec![layers.range()];
        let mut to = LayeredPointRecordDecompressor::new(Splice { front: Cursor::new(front), file, ranges });
        for item in items {
            let (kind, old) = (item.item_type(), item.version() == 3);
            match kind {
                Point14 if old => to.add_field_decompressor(v3::LasPoint6Decompressor::default()),
                Point14 => to.add_field_decompressor(v4::LasPoint6Decompressor::default()),
                RGB14 | RGBNIR14 if old => to.add_field_decompressor(v3::LasRGBDecompressor::default()),
                RGB14 | RGBNIR14 => to.add_field_decompressor(v4::LasRGBDecompressor::default()),
                WavePacket14 if old => to.add_field_decompressor(v3::LasWavepacketDecompressor::default()),
                WavePacket14 => to.add_field_decompressor(v4::LasWavepacketDecompressor::default()),
                Byte14(n) if old => to.add_field_decompressor(v3::LasExtraByteDecompressor::new(n.into())),
                Byte14(n) => to.add_field_decompressor(v4::LasExtraByteDecompressor::new(n.into())),
                _ => unreachable!("item {kind:?} passed the checks"),
            }
            match kind {
                RGBNIR14 if old => to.add_field_decompressor(v3::LasNIRDecompressor::default()),
                RGBNIR14 => to.add_field_decompressor(v4::LasNIRDecompressor::default()),
                _ => {}
            }
        }
        Layered { inner: to, times: None }
    }
}

impl Records for Layered<'_> {
    fn decode(&mut self, raw: &mut [u8], len: usize) -> Result<(), Stop> {
        for record in raw.chunks_exact_mut(len) {
            self.inner.decompress_next(record).map_err(|error| Stop { error, sound: 0 })?;
            if let Some(times) = &mut self.times {
                let time = times.next().map_err(|error| Stop { error, sound: 0 })?;
                record[22..30].copy_from_slice(&time);
            }
        }
        Ok(())
    }
}

/// Where the columns stand in a raw record (LAS 1.4 R15, tables 7 to 18).
#[derive(Clone, Copy, Debug)]
struct RecordLayout {
    /// Bytes in a record.
    len: usize,
    /// Formats 6 to 10.
    extended: bool,
    /// First byte of R, G, B.
    rgb: Option<usize>,
    /// First byte of the GPS time.
    gps_time: Option<usize>,
    /// What LASzip's compatibility mode keeps apart.
    kept_apart: Option<KeptApart>,
}

impl RecordLayout {
    fn of(header: &FileHeader) -> RecordLayout {
        let rgb = match header.stored_format {
            2 => Some(20),
            3 | 5 => Some(28),
            7 | 8 | 10 => Some(30),
            _ => None,
        };
        let extended = header.stored_format >= 6;
        let gps_time = match header.stored_format {
            0 | 2 => None,
            1 | 3..=5 => Some(20),
            _ => Some(22),
        };
        RecordLayout { len: header.record_len.into(), extended, rgb, gps_time, kept_apart: header.kept_apart }
    }

    /// The front of a record, up to the last column.
    fn head(self) -> RecordLayout {
        let base = self.gps_time.map_or(20, |at| at + 8);
        let end = self.rgb.map_or(base, |at| at + 6).max(self.kept_apart.map_or(0, |kept| kept.end()));
        RecordLayout { len: end, ..self }
    }

    /// What is decoded of a layered record: its head.
    fn of_layers(header: &FileHeader) -> RecordLayout {
        RecordLayout::of(header).head()
    }

    /// Whole records in `bytes`, at least one, at most a block.
    fn records_in(&self, bytes: usize) -> u64 {
        (bytes / self.len).clamp(1, BLOCK_RECORDS) as u64
    }

    /// Takes whole records apart into `block`, with these fields.
    fn extract(&self, raw: &[u8], fields: Fields, block: &mut PointBlock) {
        let n = raw.len() / self.len;
        block.x.resize(n, 0);
        block.y.resize(n, 0);
        block.z.resize(n, 0);
        block.class.resize(n, 0);
        block.flags.resize(n, 0);
        block.intensity.resize(n, 0);
        block.returns.resize(n, 0);
        // Slices of one length let the compiler drop the bounds checks.
        let (x, y, z) = (&mut block.x[..n], &mut block.y[..n], &mut block.z[..n]);
        let (class, flags) = (&mut block.class[..n], &mut block.flags[..n]);
        let (intensity, returns) = (&mut block.intensity[..n], &mut block.returns[..n]);
        for (i, record) in raw.chunks_exact(self.len).enumerate() {
            let r: &[u8; 20] = record[..20].try_into().unwrap();
            x[i] = i32::from_le_bytes([r[0], r[1], r[2], r[3]]);
            y[i] = i32::from_le_bytes([r[4], r[5], r[6], r[7]]);
            z[i] = i32::from_le_bytes([r[8], r[9], r[10], r[11]]);
            intensity[i] = u16::from_le_bytes([r[12], r[13]]);
            if self.extended {
                returns[i] = r[14];
                flags[i] = r[15] & 0xf;
                class[i] = r[16];
            } else {
                returns[i] = r[14] & 7 | (r[14] << 1) & 0x70;
                flags[i] = r[15] >> 5;
                class[i] = r[15] & 0x1f;
            }
        }
        if let Some(kept_apart) = &self.kept_apart {
            for (i, record) in raw.chunks_exact(self.len).enumerate() {
                kept_apart.restore(record, &mut returns[i], &mut class[i], &mut flags[i]);
            }
        }
        block.rgb.clear();
        if let Some(at) = self.rgb {
            block.rgb.extend(raw.chunks_exact(self.len).map(|record| {
                let c: &[u8; 6] = record[at..at + 6].try_into().unwrap();
                [0, 2, 4].map(|k| u16::from_le_bytes([c[k], c[k + 1]]))
            }));
        }
        block.source_id.clear();
        block.scan_angle.clear();
        block.gps_time.clear();
        if fields != Fields::default() {
            self.extract_more(raw, fields, block);
        }
    }
    fn extract_more(&self, raw: &[u8], fields: Fields, block: &mut PointBlock) {
        let records = || raw.chunks_exact(self.len);
        let word = |record: &[u8], at: usize| [record[at], record[at + 1]];
        if fields.source_id {
            let at = if self.extended { 20 } else { 18 };
            block.source_id.extend(records().map(|record| u16::from_le_bytes(word(record, at))));
        }
        if fields.scan_angle && self.extended {
            block.scan_angle.extend(records().map(|record| i16::from_le_bytes(word(record, 18))));
        } else if fields.scan_angle {
            block.scan_angle.extend(records().map(|record| {
                let degrees = (f64::from(record[16] as i8) / 0.006).round() as i16;
                self.kept_apart.map_or(degrees, |kept_apart| kept_apart.angle(record, degrees))
            }));
        }
        if let Some(at) = self.gps_time.filter(|_| fields.gps_time) {
            block.gps_time.extend(records().map(|record| {
                let bytes: [u8; 8] = record[at..at + 8].try_into().unwrap();
                f64::from_le_bytes(bytes)
            }));
        }
    }
}
