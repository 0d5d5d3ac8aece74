//! What goes wrong on the way, told so that thousands of files with one fault do not flood the terminal.

use crate::text::harmless;
use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, Write};

/// Lines of one wording that are printed; further ones are counted.
const MOST_ALIKE: u64 = 5;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// A decision that is not obvious.
    Note,
    /// Something is wrong with an input.
    Warning,
    /// An input, or a part of it, is not drawn.
    Error,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        })
    }
}

/// Lines for the user, in the order in which they came up: `path: place: reason`.
#[derive(Debug, Default)]
pub struct Problems {
    /// An input, or a part of it, is missing.
    pub failed: bool,
    lines: Vec<(Severity, String)>,
    /// Lines so far, by wording.
    alike: BTreeMap<(Severity, String), u64>,
    said: u64,
}

impl Problems {
    /// Adds a note.
    pub fn note(&mut self, line: impl ToString) {
        self.push(Severity::Note, line.to_string());
    }

    /// Adds a warning.
    pub fn warn(&mut self, line: impl ToString) {
        self.push(Severity::Warning, line.to_string());
    }

    /// Adds an error: an input, or a part of it, is missing.
    pub fn error(&mut self, line: impl ToString) {
        self.failed = true;
        self.push(Severity::Error, line.to_string());
    }

    /// Lines hold names and words out of files: here is where those become harmless.
    fn push(&mut self, severity: Severity, line: String) {
        let line = harmless(&line);
        self.said += u64::from(severity > Severity::Note);
        let count = self.alike.entry((severity, wording(&line))).or_default();
        *count += 1;
        if *count <= MOST_ALIKE {
            self.lines.push((severity, line));
        }
    }

    /// Lines that were not printed, each with its severity, instead of printing them.
    pub fn take_lines(&mut self) -> Vec<String> {
        self.lines.drain(..).map(|(severity, line)| format!("{severity}: {line}")).collect()
    }

    /// Warnings and errors so far, printed or not.
    pub fn said(&self) -> u64 {
        self.said
    }

    /// Prints what has come up since the last time; notes only where they are wanted.
    pub fn print(&mut self, notes: bool, out: &mut impl Write) -> io::Result<()> {
        for (severity, line) in self.lines.drain(..) {
            if notes || severity > Severity::Note {
                writeln!(out, "{severity}: {line}")?;
            }
        }
        Ok(())
    }

    /// Prints the rest, and how many lines of each wording were left out.
    pub fn finish(&mut self, notes: bool, out: &mut impl Write) -> io::Result<()> {
        self.print(notes, out)?;
        for ((severity, wording), count) in std::mem::take(&mut self.alike) {
            if count > MOST_ALIKE && (notes || severity > Severity::Note) {
                writeln!(out, "{severity}: and {} more: {wording}", count - MOST_ALIKE)?;
            }
        }
        Ok(())
    }
}

/// What lines about different files have in common: what stands behind the last colon, without numbers.
fn wording(line: &str) -> String {
    let reason = line.rsplit_once(": ").map_or(line, |(_, reason)| reason);
    let mut wording = String::new();
    let mut letters = reason.chars().peekable();
    while let Some(letter) = letters.next() {
        if !letter.is_ascii_digit() {
            wording.push(letter);
            continue;
        }
        wording.push('…');
        while letters.next_if(|c| c.is_ascii_digit() || *c == '.').is_some() {}
    }
    wording
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_alike_are_counted() {
        let mut problems = Problems::default();
        for k in 0..2000 {
            problems.warn(format!("tile {k}.las: header claims {k} points, 7 can be read"));
            if k % 1000 == 0 {
                problems.error(format!("tile {k}.laz: chunk 3 at byte 99: cut"));
            }
        }
        problems.note("heights are in feet");
        let mut out = Vec::new();
        problems.print(false, &mut out).unwrap();
        problems.warn("tile 9999.las: header claims 3 points, 3.5 can be read");
        problems.finish(false, &mut out).unwrap();
        let out = String::from_utf8(out).unwrap();
        let lines: Vec<_> = out.lines().collect();
        assert_eq!(lines.len(), 5 + 2 + 1, "{out}");
        assert_eq!(lines[0], "warning: tile 0.las: header claims 0 points, 7 can be read");
        assert_eq!(lines[7], "warning: and 1996 more: header claims … points, … can be read");
        assert_eq!((problems.said(), problems.failed), (2003, true));
    }
}
