//! The command line.

use crate::command::{self, UsageError, saved};
use clap::{CommandFactory, Parser, Subcommand};
use std::ffi::OsString;
use std::path::Path;

/// Opens raw airborne LiDAR (LAS, LAZ, COPC) and ray-traces it on any Vulkan GPU
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, max_term_width = 100, after_help = EXAMPLES)]
pub struct Cli {
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

const EXAMPLES: &str = "\
Examples:
  lasray tiles/                                       the whole folder in a window
  lasray                                              a window that files can be dropped into
  lasray render tiles/ -o city.png                    the whole folder, framed, in its own colours
  lasray render tiles/ -o map.png --ortho 0.25        a map from above, with world file
  lasray render a.laz --orbit 45,20 --hide 3,4,5 -o bare.png
  lasray info tiles/ --scan                           what is in the files
  lasray synth town/ --points 20M --tiles 2x2         a town to try things with
";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Open a window and look around (also without the word: lasray, lasray INPUT)
    #[cfg(feature = "view")]
    View(Box<command::view::Args>),
    /// Draw a picture: PNG for people, EXR with distances, heights and classes for programs
    Render(Box<command::render::Args>),
    /// What is in the files, and how they would be drawn
    Info(Box<command::info::Args>),
    /// Time copy, prepare and trace beside the pipeline of the thesis
    Bench(Box<command::bench::Args>),
    /// Write the scan of a town that does not exist, with known geometry
    Synth(command::synth::Args),
}

impl Cli {
    /// Parses the command line, with what the saved view says that it opens. Ends the process with code 2 where the words
    /// are wrong.
    pub fn of(words: Vec<OsString>) -> Result<Cli, UsageError> {
        let cli = Cli::parse_from(&words);
        let command = Cli::command();
        let with_view = |name: &str, typed: Vec<OsString>, file: &Path, is_window: bool| {
            let command = command.find_subcommand(name).expect("a command of ours");
            saved::typed_with_view(command, &typed, file, is_window)
        };
        let (words, file) = match &cli.command {
            Command::Render(args) => match args.saved_view() {
                Some(file) => (with_view("render", words, file, false)?, file),
                None => return Ok(cli),
            },
            #[cfg(feature = "view")]
            Command::View(args) => match args.saved_view() {
                // The camera is looked through.
                Some((file, true)) => {
                    let is_file = |word: &OsString| word == file.as_os_str();
                    let at = words.iter().rposition(is_file).expect("it was typed");
                    let mut typed = words;
                    typed.remove(at);
                    let mut saved = OsString::from("--saved=");
                    saved.push(file);
                    // Behind the command's name.
                    typed.insert(2, saved);
                    (with_view("view", typed, file, true)?, file)
                }
                // The path is flown.
                Some((file, false)) => (with_view("view", words, file, true)?, file),
                None => return Ok(cli),
            },
            _ => return Ok(cli),
        };
        Cli::try_parse_from(words).map_err(|error| saved::wrong_option(file, &error))
    }
}

/// The words of the command line, with `view` where inputs stand in the place of a command, or nothing does.
pub fn words(given: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut words: Vec<_> = given.into_iter().collect();
    let is_input = words.get(1).is_some_and(|word| {
        let text = word.to_string_lossy();
        // A command that is misspelt is no file.
        let is_path = text.contains(['/', '\\', '.', '*', '?']) || Path::new(word).exists();
        !text.starts_with('-') && (is_path || text.starts_with('@')) && !is_command(&text)
    });
    if (is_input || words.len() == 1) && cfg!(feature = "view") {
        words.insert(1, "view".into());
    }
    words
}

fn is_command(word: &str) -> bool {
    word == "help" || Command::has_subcommand(word)
}

#[cfg(all(test, feature = "view"))]
mod tests {
    use super::*;

    #[test]
    fn inputs_without_a_command_are_viewed() {
        let second = |word: &str| {
            let words = words(["lasray", word].map(OsString::from));
            (words.len() == 3).then(|| words[1].to_string_lossy().into_owned())
        };
        for word in ["a.laz", "tiles/", ".", "@list.txt", "*.las", "src"] {
            assert_eq!(second(word).as_deref(), Some("view"), "{word}");
        }
        for word in ["render", "rendre", "--help", "-V", "help", "view", "info"] {
            assert_eq!(second(word), None, "{word}");
        }
        assert_eq!(words([OsString::from("lasray")]), ["lasray", "view"]);
    }
}
