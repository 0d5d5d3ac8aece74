//! Reading and binning beside decoding alone, in one run: M points/s of LAS and LAZ.
//!
//! `cargo bench --bench ingest [-- [--cold] [--cell C] [--runs N] [FILE | POINTS]...]` (default 20M); files are made in
//! a temporary folder and removed at its end. With several numbers of points, each after the other.

use std::sync::atomic::AtomicBool;

use lasray::bench::ingest::{Cache, IngestOptions, IngestRow, run};

fn main() -> anyhow::Result<()> {
    let mut options = IngestOptions { cell: Some(1.0), cold: false, ..IngestOptions::default() };
    let mut sizes = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let number = argument.trim_end_matches('M').parse::<u64>();
        match (argument.as_str(), number) {
            ("--bench", _) => {}
            ("--cold", _) => options.cold = true,
            ("--cell", _) => options.cell = arguments.next().and_then(|c| c.parse().ok()),
            ("--runs", _) => {
                options.runs = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(options.runs)
            }
            (_, Ok(millions)) => sizes.push(millions * 1_000_000),
            (path, _) => options.files.push(path.into()),
        }
    }
    if sizes.is_empty() {
        sizes.push(options.points);
    }
    println!(
        "{:<28} {:>3} {:>9} {:>2} {:>4} | {:>7} {:>7} {:>7} {:>6} | {:>5} {:>6} {:>7} | {:>10} {:>7} {:>6}",
        "file",
        "fmt",
        "points",
        "T",
        "",
        "decode",
        "prepare",
        "total",
        "t/d",
        "read",
        "decode",
        "prepare",
        "all layers",
        "skipped",
        "gain"
    );
    let mut smaller = Vec::<IngestRow>::new();
    for points in sizes {
        let mut rows = Vec::new();
        run(&IngestOptions { points, ..options.clone() }, &mut |_| (), &AtomicBool::new(false), &mut rows)?;
        for row in &rows {
            let percent = |share: f64| format!("{:.0} %", 100.0 * share);
            println!(
                "{:<28} {:>3} {:>9} {:>2} {:>4} | {:>7.2} {:>7.1} {:>7.2} {:>6} | {:>5} {:>6} {:>7} | {:>10} {:>7} {:>6} {}",
                row.file,
                row.format,
                row.points,
                row.threads,
                if row.cache == Cache::Cold { "cold" } else { "warm" },
                row.decode_mpts_s,
                row.prepare_mpts_s,
                row.total_mpts_s,
                percent(row.share_of_decoding()),
                row.read_share.map_or("-".into(), percent),
                row.decode_share.map_or("-".into(), percent),
                row.prepare_share.map_or("-".into(), percent),
                row.all_layers_mpts_s.map_or("-".into(), |r| format!("{r:.2}")),
                row.skipped_bytes_share.map_or("-".into(), percent),
                row.gain_of_skipping().map_or("-".into(), |g| format!("{g:.2}")),
                row.note.as_deref().unwrap_or_default(),
            );
        }
        for (few, many) in smaller.iter().zip(&rows) {
            let seconds = |row: &IngestRow| row.points as f64 / row.total_mpts_s;
            let (file, times) = (&few.file, many.points as f64 / few.points as f64);
            println!(
                "{file}, {} threads: {times} times the points, {:.2} times the time",
                few.threads,
                seconds(many) / seconds(few)
            );
        }
        smaller = rows;
    }
    Ok(())
}
