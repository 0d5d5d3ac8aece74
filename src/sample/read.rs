//! Reads the sample: first points of chunks, and the points of places.

use super::budget::SampleBudget;
use super::open::Opened;
use super::parallel::parallel;
use super::places::Place;
use super::rgb::{self, RGB_POINTS};
use super::seen::{Seen, append};
use crate::source::{Fields, PointBlock, Selection, SourceError};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Most files that are read further.
const RGB_FILES: usize = 512;

/// The first points of chunks of every file: where it lies, and a thin sample over all of it.
pub(super) fn read_firsts(
    files: &[Opened],
    selection: &Selection,
    budget: &SampleBudget,
    problems: &mut Vec<(usize, SourceError)>,
) -> Vec<Vec<Seen>> {
    let most = (budget.first_points / files.len().max(1)).max(1);
    let firsts = parallel(files.len(), |decoder, index| {
        let file = &files[index].file;
        let mut seen = Vec::new();
        decoder.set_fields(Fields::ALL);
        let read = match file.chunks.is_empty() {
            true => Ok(()),
            false => decoder.first_points(file, most).map(|block| append(block, selection, &mut seen)),
        };
        file.bytes.release();
        (seen, read.err())
    });
    let unpacked = firsts.into_iter().enumerate().map(|(index, (seen, error))| {
        problems.extend(error.map(|error| (index, error)));
        seen
    });
    unpacked.collect()
}

/// The points of each place.
pub(super) fn read_places(
    files: &[Opened],
    selection: &Selection,
    places: &[Place],
    problems: &mut Vec<(usize, SourceError)>,
) -> Vec<Vec<Seen>> {
    // Chunk by chunk: two tiles of a few chunks keep all cores busy.
    let jobs: Vec<(usize, usize, u64)> = places
        .iter()
        .enumerate()
        .flat_map(|(place, at)| at.chunks.iter().map(move |&(chunk, records)| (place, chunk, records)))
        .collect();
    let left: Vec<AtomicUsize> = places.iter().map(|place| AtomicUsize::new(place.chunks.len())).collect();
    let read = parallel(jobs.len(), |decoder, index| {
        let (place, chunk, records) = jobs[index];
        let file = &files[places[place].file].file;
        let mut seen = Vec::new();
        decoder.set_fields(Fields::ALL);
        let sink = &mut |block: &PointBlock| append(block, selection, &mut seen);
        let error = decoder.decode(file, &file.chunks[chunk], 0..records, sink).err();
        if left[place].fetch_sub(1, Ordering::Relaxed) == 1 {
            file.bytes.release();
        }
        (seen, error)
    });
    let mut of_places = vec![Vec::new(); places.len()];
    for ((place, ..), (seen, error)) in jobs.into_iter().zip(read) {
        problems.extend(error.map(|error| (places[place].file, error)));
        if of_places[place].is_empty() {
            of_places[place] = seen;
        } else {
            of_places[place].extend(seen);
        }
    }
    of_places
}

/// RGB of sampled points a file; where those are few, of some more.
pub(super) fn rgb_of(
    files: &[Opened],
    drawn: &[usize],
    firsts: &[Vec<Seen>],
    places: &[Place],
    seen: &[Vec<Seen>],
    whole: bool,
) -> Vec<Vec<[u16; 3]>> {
    let mut rgb: Vec<Vec<[u16; 3]>> =
        firsts.iter().map(|seen| seen.iter().map(|seen| seen.rgb).collect()).collect();
    for (place, seen) in places.iter().zip(seen) {
        rgb[place.file].extend(seen.iter().map(|seen| seen.rgb));
    }
    let thin = |index: &usize| !whole && rgb::has_rgb(&files[*index].file) && rgb[*index].len() < RGB_POINTS;
    let thin: Vec<usize> = drawn.iter().copied().filter(thin).take(RGB_FILES).collect();
    let more = parallel(thin.len(), |decoder, index| {
        let file = &files[thin[index]].file;
        let mut more = Vec::new();
        // A broken chunk is reported when it is drawn; here it only tells less.
        if let Some(chunk) = file.chunks.get(file.chunks.len() / 2) {
            let sink = &mut |block: &PointBlock| more.extend_from_slice(&block.rgb);
            let _ = decoder.decode(file, chunk, 0..RGB_POINTS as u64, sink);
        }
        file.bytes.release();
        more
    });
    thin.into_iter().zip(more).for_each(|(index, more)| rgb[index].extend(more));
    rgb
}
