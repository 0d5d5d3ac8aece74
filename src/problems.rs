//! What goes wrong on the way, told so that thousands of files with one fault do not flood the terminal.

use crate::source::inputs::Inputs;
use crate::text::harmless;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::{self, Write};
use std::path::Path;

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
    /// Names of the files that inputs came to.
    files: BTreeSet<String>,
    /// What is wrong with inputs that came to none.
    no_files: BTreeSet<String>,
    /// Files that are missing, in whole or in part.
    lost: BTreeSet<String>,
}

impl Problems {
    /// Takes in what inputs came to: adds what is wrong with them, and counts errors about their files from now on.
    pub fn look_at(&mut self, inputs: &Inputs) {
        self.files.extend(inputs.files.iter().map(|path| path.display().to_string()));
        for error in &inputs.failed {
            self.no_files.insert(error.to_string());
            self.error(error);
        }
    }

    /// A file is missing, in whole or in part; why has been said.
    pub fn lost(&mut self, path: &Path) {
        self.failed = true;
        let name = path.display().to_string();
        if self.files.contains(&name) {
            self.lost.insert(name);
        }
    }

    /// How many inputs are missing, in whole or in part; `None`: none is.
    pub fn count(&self) -> Option<String> {
        let missing = self.no_files.len() + self.lost.len();
        let all = self.no_files.len() + self.files.len();
        let s = if all == 1 { "" } else { "s" };
        (missing > 0).then(|| format!("{missing} of {all} input{s} left out or failed"))
    }

    /// Takes over what others have found that looked at more inputs; their lines as they are.
    pub fn join(&mut self, others: Problems) {
        self.files.extend(others.files);
        self.no_files.extend(others.no_files);
        self.lost.extend(others.lost);
        for (severity, line) in others.lines {
            match severity {
                Severity::Error => self.error(line),
                _ => self.push(severity, line),
            }
        }
    }

    /// None of the files looked at is used.
    pub fn lose_all(&mut self) {
        self.lost.extend(self.files.iter().cloned());
    }

    /// Adds a note.
    pub fn note(&mut self, line: impl ToString) {
        self.push(Severity::Note, line.to_string());
    }

    /// Adds a warning.
    pub fn warn(&mut self, line: impl ToString) {
        self.push(Severity::Warning, line.to_string());
    }

    /// Adds an error: an input, or a part of it, is missing: the file that the line begins with.
    pub fn error(&mut self, line: impl ToString) {
        self.failed = true;
        let line = line.to_string();
        self.blame(&line);
        self.push(Severity::Error, line);
    }

    /// Counts the file that `line`, said elsewhere, begins with.
    pub fn blame(&mut self, line: &str) {
        let mut names = line.match_indices(": ").map(|(at, _)| &line[..at]);
        if let Some(name) = names.find(|name| self.files.contains(*name)) {
            self.lost.insert(name.to_owned());
        }
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

    /// Lines that were not printed, each with its severity.
    pub fn lines(&self) -> Vec<String> {
        self.lines.iter().map(|(severity, line)| format!("{severity}: {line}")).collect()
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

    #[test]
    fn inputs_are_counted_once_each() {
        let gone = |name: &str| crate::source::inputs::InputError::Missing { path: name.into() };
        let inputs = Inputs {
            files: ["a.las", "b: c.las", "d.las", "e.las"].map(Into::into).into(),
            failed: vec![gone("x.las"), gone("y.las")],
            ..Inputs::default()
        };
        let mut problems = Problems::default();
        problems.look_at(&Inputs { failed: Vec::new(), files: inputs.files.clone(), ..Inputs::default() });
        assert_eq!((problems.count(), problems.failed), (None, false));
        problems.look_at(&inputs);
        assert_eq!(problems.count().unwrap(), "2 of 6 inputs left out or failed");
        for line in
            ["a.las: chunk 1: cut", "a.las: chunk 2: cut", "b: c.las: empty file", "other: cut", "cut"]
        {
            problems.error(line);
        }
        problems.warn("e.las: bounds are odd");
        assert_eq!(problems.count().unwrap(), "4 of 6 inputs left out or failed");
        problems.lost(Path::new("d.las"));
        problems.lost(Path::new("z.las"));
        assert_eq!(problems.count().unwrap(), "5 of 6 inputs left out or failed");
        let mut more = Problems::default();
        more.look_at(&Inputs { files: vec!["f.las".into()], ..Inputs::default() });
        more.lose_all();
        problems.join(more);
        assert_eq!(problems.count().unwrap(), "6 of 7 inputs left out or failed");
    }
}
