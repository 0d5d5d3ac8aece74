//! The command line.

use crate::command::{self, UsageError, saved};
use crate::source::length::Length;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser, Subcommand};
use std::ffi::{OsStr, OsString};
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
  lasray render tiles/                                tiles.png: all of it, framed, in its own colours
  lasray render tiles/ map.png --ortho 25cm           a map from above, with world file
  lasray render a.laz --orbit 45,20 --hide vegetation -o bare.jpg
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
    /// are wrong, with 0 where help was asked for.
    pub fn of(words: Vec<OsString>) -> Result<Cli, UsageError> {
        let cli = parse(&words).unwrap_or_else(|error| error.exit());
        let command = Cli::command();
        let with_view = |name: &str, typed: Vec<OsString>, file: &Path, is_window: bool| {
            let command = command.find_subcommand(name).expect("a command of ours");
            saved::typed_with_view(command, &typed, file, is_window)
        };
        let (words, file) = match &cli.command {
            Command::Render(args) => match args.saved_view() {
                Some((file, picture)) => {
                    let mut typed = words;
                    // The picture comes behind the inputs.
                    let picture = picture.map(|picture| take_word(&mut typed, picture));
                    let mut words = with_view("render", typed, file, false)?;
                    words.extend(picture);
                    (words, file)
                }
                None => return Ok(cli),
            },
            #[cfg(feature = "view")]
            Command::View(args) => match args.saved_view() {
                // The camera is looked through.
                Some((file, true)) => {
                    let mut typed = words;
                    take_word(&mut typed, file.as_os_str());
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

/// Takes the input `word` out of `words`, which hold it: not the value of an option, where there is another.
fn take_word(words: &mut Vec<OsString>, word: &OsStr) -> OsString {
    let is_word = |at: &usize| words[*at] == *word;
    let is_value = |at: usize| words[at - 1].to_string_lossy().starts_with("--") && words[at - 1] != "--";
    let all: Vec<usize> = (1..words.len()).filter(is_word).collect();
    let at = all.iter().copied().find(|&at| !is_value(at)).unwrap_or(all[0]);
    words.remove(at)
}

/// The words of the command line, with `view` where inputs stand in the place of a command, or nothing does, and the number
/// behind `--ortho`, which may be without, joined to it: it takes no input for one.
pub fn words(given: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut words: Vec<_> = given.into_iter().collect();
    let is_input = words.get(1).is_some_and(|word| {
        let text = word.to_string_lossy();
        // A command that is misspelt is no file.
        let is_path = text.contains(['/', '\\', '.', '*', '?']) || Path::new(word).exists();
        let is_free = is_path || text.starts_with('@') || !is_nearly_a_command(&text);
        !text.starts_with('-') && is_free && !is_command(&text)
    });
    if (is_input || words.len() == 1) && cfg!(feature = "view") {
        words.insert(1, "view".into());
    }
    let end = words.iter().position(|word| word == "--").unwrap_or(words.len());
    // A unit that stands apart belongs to its number.
    for at in (1..end.saturating_sub(2)).rev() {
        let is_length = words[at] == "--cell" || words[at] == "--ortho";
        let joined = [&words[at + 1], &words[at + 2]].map(|word| word.to_string_lossy()).concat();
        let is_unit = words[at + 2].to_string_lossy().chars().all(char::is_alphabetic);
        if is_length && is_unit && joined.parse::<Length>().is_ok() && !Path::new(&words[at + 2]).exists() {
            words.splice(at + 1..at + 3, [joined.into()]);
        }
    }
    let end = words.iter().position(|word| word == "--").unwrap_or(words.len());
    for at in (1..end.saturating_sub(1)).rev() {
        let is_length = words[at + 1].to_str().is_some_and(Length::is_meant_by);
        if words[at] == "--ortho" && is_length {
            let length = words.remove(at + 1);
            words[at].push("=");
            words[at].push(length);
        }
    }
    words
}

/// Reads the command line. Tips name what is spelt nearly so, and nothing else.
pub fn parse(words: &[OsString]) -> Result<Cli, clap::Error> {
    Cli::try_parse_from(words).map_err(|mut error| {
        let kinds = [
            (ContextKind::InvalidArg, ContextKind::SuggestedArg),
            (ContextKind::InvalidSubcommand, ContextKind::SuggestedSubcommand),
            (ContextKind::InvalidValue, ContextKind::SuggestedValue),
        ];
        for (wrong, suggested) in kinds {
            let wrong = strings(error.get(wrong));
            let tips = strings(error.get(suggested));
            let near: Vec<String> =
                tips.iter().filter(|tip| wrong.iter().any(|word| is_near(word, tip))).cloned().collect();
            if near.len() < tips.len() {
                error.remove(suggested);
                // It was made for the tip.
                error.remove(ContextKind::Usage);
                if let [first, ..] = &near[..] {
                    let value = match suggested {
                        ContextKind::SuggestedSubcommand => ContextValue::Strings(near),
                        _ => ContextValue::String(first.clone()),
                    };
                    error.insert(suggested, value);
                }
            }
        }
        // That a word may be taken for a value is of no use where it is an option.
        if error.kind() == ErrorKind::UnknownArgument {
            error.remove(ContextKind::Suggested);
        }
        error
    })
}

fn strings(value: Option<&ContextValue>) -> Vec<String> {
    match value {
        Some(ContextValue::String(one)) => vec![one.clone()],
        Some(ContextValue::Strings(all)) => all.clone(),
        _ => Vec::new(),
    }
}

/// Whether one word is the other with a slip of the hand: one letter in three at most.
fn is_near(word: &str, known: &str) -> bool {
    let plain =
        |text: &str| text.trim_start_matches('-').split('=').next().unwrap_or_default().to_lowercase();
    let (word, known) = (plain(word), plain(known));
    let most = known.chars().count().max(word.chars().count()) / 3;
    // A beginning that is long enough is meant, too.
    let begins = word.len() >= 3 && known.starts_with(&word);
    begins || strsim::osa_distance(&word, &known) <= most
}

fn is_nearly_a_command(word: &str) -> bool {
    let commands = Cli::command();
    commands
        .get_subcommands()
        .map(|command| command.get_name())
        .chain(["help"])
        .any(|name| is_near(word, name))
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
        for word in ["a.laz", "tiles/", ".", "@list.txt", "*.las", "src", "nosuchfolder", "north", "Daten"] {
            assert_eq!(second(word).as_deref(), Some("view"), "{word}");
        }
        for word in ["render", "rendre", "ifno", "bnech", "rend", "--help", "-V", "help", "view", "info"] {
            assert_eq!(second(word), None, "{word}");
        }
        assert_eq!(words([OsString::from("lasray")]), ["lasray", "view"]);
    }

    #[test]
    fn a_number_behind_ortho_is_its_own() {
        let joined = |line: &str| {
            let words = words(line.split(' ').map(OsString::from));
            words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
        };
        for (typed, read) in [
            ("lasray render --ortho tiles/", "lasray render --ortho tiles/"),
            ("lasray render --ortho 0.25 tiles/", "lasray render --ortho=0.25 tiles/"),
            ("lasray render tiles/ --ortho 25cm", "lasray render tiles/ --ortho=25cm"),
            ("lasray render tiles/ --ortho", "lasray render tiles/ --ortho"),
            ("lasray render tiles/ --ortho -1", "lasray render tiles/ --ortho=-1"),
            ("lasray render --ortho 25 cm tiles/", "lasray render --ortho=25cm tiles/"),
            ("lasray render tiles/ --cell 50 cm -o a.png", "lasray render tiles/ --cell 50cm -o a.png"),
            ("lasray render --cell 50 tiles", "lasray render --cell 50 tiles"),
            ("lasray render --ortho -o a.png t", "lasray render --ortho -o a.png t"),
            ("lasray render --ortho 2024.laz", "lasray render --ortho 2024.laz"),
            ("lasray render -- --ortho 1", "lasray render -- --ortho 1"),
            ("lasray render --ortho --", "lasray render --ortho --"),
        ] {
            assert_eq!(joined(typed), read);
        }
    }

    #[test]
    fn tips_are_near() {
        let said = |line: &str| {
            let error = parse(&words(line.split(' ').map(OsString::from))).unwrap_err();
            error.render().to_string()
        };
        for (line, tip) in [
            ("lasray render a.las --sun 3", None),
            ("lasray render a.las --wrong", None),
            ("lasray render a.las --clases 2", Some("--classes")),
            ("lasray render a.las --otho 2", Some("--ortho")),
            ("lasray render a.las --back white", Some("--background")),
            ("lasray render a.las --background wite", Some("white")),
            ("lasray render a.las --shade dark", None),
            ("lasray rendre a.las", Some("render")),
        ] {
            let said = said(line);
            match tip {
                Some(tip) => assert!(said.contains("similar") && said.contains(tip), "{said}"),
                None => assert!(!said.contains("tip:"), "{said}"),
            }
        }
    }
}
