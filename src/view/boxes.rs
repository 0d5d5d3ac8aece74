//! The small boxes over the image: where to go, what to open, and the list of keys.

use super::input::KEYS;
use super::widgets::{WARN, weak};
use egui::text::{CCursor, CCursorRange};
use egui::{Align2, Key, Modifiers, Response, RichText, ScrollArea, TextEdit, Ui, Vec2, vec2};
use std::ffi::OsString;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// Paths that are offered while one is typed.
const MOST_OFFERED: usize = 8;
/// Extensions of files that are offered.
const OPENED: [&str; 3] = ["las", "laz", "json"];

/// The box that asks what to open.
#[derive(Debug, Default)]
pub struct OpenBox {
    /// What is typed.
    pub text: String,
    /// What was typed when paths were looked for.
    looked_for: Option<String>,
    offered: Vec<String>,
}

/// What is to be opened.
#[derive(Debug, PartialEq)]
pub struct OpenRequest {
    /// Files, folders, lists and patterns, or a saved view.
    pub inputs: Vec<OsString>,
    /// In the place of what is open.
    pub instead: bool,
}

/// The home folder.
fn home() -> Option<PathBuf> {
    std::env::var_os(if cfg!(windows) { "USERPROFILE" } else { "HOME" }).map(PathBuf::from)
}

/// A path as it is typed: `~` is the home folder.
fn path_of(typed: &str) -> PathBuf {
    match (typed.strip_prefix("~/"), home()) {
        (Some(rest), Some(home)) => home.join(rest),
        _ => PathBuf::from(typed),
    }
}

/// What is typed: one path, or several in quotes or with spaces between them.
fn inputs(typed: &str) -> Result<Vec<OsString>, String> {
    let typed = typed.trim();
    let whole = path_of(typed);
    if whole.exists() {
        return Ok(vec![whole.into_os_string()]);
    }
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for letter in typed.chars() {
        match (quote, letter) {
            (None, '"' | '\'') => quote = Some(letter),
            (Some(open), _) if letter == open => quote = None,
            (None, ' ') if !word.is_empty() => words.push(std::mem::take(&mut word)),
            (None, ' ') => {}
            _ => word.push(letter),
        }
    }
    words.extend(Some(word).filter(|word| !word.is_empty()));
    let is_there =
        |word: &String| path_of(word).exists() || word.starts_with('@') || word.contains(['*', '?', '[']);
    match words.iter().find(|word| !is_there(word)) {
        _ if words.is_empty() => Err("a folder, files or a saved view".to_owned()),
        Some(_) if words.len() > 1 && quote.is_none() && !typed.contains(['"', '\'']) => {
            Err(format!("{typed}: no such file or folder"))
        }
        Some(word) => Err(format!("{word}: no such file or folder")),
        None => Ok(words.iter().map(|word| path_of(word).into_os_string()).collect()),
    }
}

/// Paths that begin as what is typed: folders, files that hold points, saved views; in the order of their names.
fn offered(typed: &str) -> Vec<String> {
    let (folder, start) = match typed.rfind(['/', MAIN_SEPARATOR]) {
        Some(at) => typed.split_at(at + 1),
        None => ("", typed),
    };
    let place = if folder.is_empty() { PathBuf::from(".") } else { path_of(folder) };
    let Ok(entries) = std::fs::read_dir(place) else { return Vec::new() };
    let offer = |entry: std::fs::DirEntry| {
        let name = entry.file_name().into_string().ok()?;
        let is_folder = entry.path().is_dir();
        let extension = Path::new(&name).extension().and_then(|e| e.to_str()).unwrap_or_default();
        let is_opened = is_folder || OPENED.iter().any(|known| extension.eq_ignore_ascii_case(known));
        let is_seen = name.starts_with(start) && (!name.starts_with('.') || start.starts_with('.'));
        let end = if is_folder { "/" } else { "" };
        (is_seen && is_opened).then(|| format!("{folder}{name}{end}"))
    };
    let mut found: Vec<_> = entries.flatten().filter_map(offer).collect();
    found.sort();
    found
}

/// What all of `offered` begin with.
fn shared_start(offered: &[String]) -> &str {
    let Some((first, rest)) = offered.split_first() else { return "" };
    let is_shared = |end: &usize| rest.iter().all(|other| other.starts_with(&first[..*end]));
    let ends = first.char_indices().map(|(at, letter)| at + letter.len_utf8());
    &first[..ends.take_while(is_shared).last().unwrap_or(0)]
}

impl OpenBox {
    fn look(&mut self) {
        if self.looked_for.as_ref() != Some(&self.text) {
            self.offered = offered(&self.text);
            self.looked_for = Some(self.text.clone());
        }
    }

    /// The box's content; what is to be opened, and whether instead of what is open, once that is said.
    fn show(
        &mut self,
        ui: &mut Ui,
        (focus, is_more): (bool, bool),
        refused: Option<&str>,
        places: &mut Vec<(String, egui::Pos2)>,
    ) -> Option<bool> {
        let id = ui.id().with("path");
        self.look();
        if focus {
            // Before the field takes the keys of this frame.
            ui.memory_mut(|memory| memory.request_focus(id));
            self.to_end(ui, id);
        }
        // Tab goes on in the path, not to another widget.
        let is_tab = ui.memory(|memory| memory.has_focus(id))
            && ui.input_mut(|input| input.consume_key(Modifiers::NONE, Key::Tab));
        let start = shared_start(&self.offered);
        if is_tab && start.len() > self.text.len() {
            self.text = start.to_owned();
            self.to_end(ui, id);
        }
        let edit = TextEdit::singleline(&mut self.text).id(id).lock_focus(true);
        let edit = ui.add(edit.hint_text("folder, files or a saved view").desired_width(420.0));
        places.push(("open box".to_owned(), edit.rect.center()));
        if focus {
            // A box that is new has had no field until now.
            edit.request_focus();
        }
        // With the keys that were down as it went down: by the end of a long frame they may be up again.
        let pressed = ui.input(|input| {
            input.events.iter().find_map(|event| match event {
                egui::Event::Key { key: Key::Enter, pressed: true, modifiers, .. } => Some(modifiers.command),
                _ => None,
            })
        });
        // The field itself ends by the plain key alone.
        let mut done = match pressed {
            Some(false) if edit.lost_focus() => Some(false),
            Some(true) if edit.has_focus() => Some(true),
            _ => None,
        };
        if let Some(refused) = refused {
            ui.label(RichText::new(refused).color(WARN).small());
        }
        let mut chosen = None;
        for path in self.offered.iter().take(MOST_OFFERED).filter(|path| **path != self.text) {
            if ui.add(egui::Label::new(weak(path).small()).sense(egui::Sense::click())).clicked() {
                chosen = Some(path.clone());
            }
        }
        let more = self.offered.len().saturating_sub(MOST_OFFERED);
        if more > 0 {
            ui.label(weak(format!("and {more} more")).small());
        }
        if let Some(path) = chosen {
            self.text = path;
            edit.request_focus();
            self.to_end(ui, id);
        }
        ui.horizontal(|ui| {
            let words = if is_more { "Add (Enter)" } else { "Open (Enter)" };
            if ui.button(words).clicked() {
                done = Some(false);
            }
            if is_more && ui.button("Instead of what is open (Ctrl+Enter)").clicked() {
                done = Some(true);
            }
            ui.label(weak("Tab completes").small());
        });
        done
    }

    /// What comes next is typed at the end.
    fn to_end(&self, ui: &Ui, id: egui::Id) {
        let mut state = TextEdit::load_state(ui.ctx(), id).unwrap_or_default();
        let end = CCursor::new(self.text.chars().count());
        state.cursor.set_char_range(Some(CCursorRange::one(end)));
        state.store(ui.ctx(), id);
    }
}

/// Numbers as they are typed: E,N or E,N,U.
fn typed(text: &str) -> Result<(f64, f64, Option<f64>), String> {
    let numbers: Vec<f64> = text
        .split([',', ';', ' '])
        .filter(|word| !word.is_empty())
        .map(|word| {
            word.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or(format!("'{word}' is not a number"))
        })
        .collect::<Result<_, _>>()?;
    match numbers[..] {
        [e, n] => Ok((e, n, None)),
        [e, n, u] => Ok((e, n, Some(u))),
        _ => Err("two or three numbers: E, N and, if you like, U".to_owned()),
    }
}

fn boxed(title: &str) -> egui::Window<'_> {
    egui::Window::new(title).anchor(Align2::CENTER_CENTER, Vec2::ZERO).collapsible(false).resizable(false)
}

/// The boxes that are open.
#[derive(Default)]
pub struct Boxes {
    /// The list of keys is there.
    pub has_keys: bool,
    /// What is typed into the box for coordinates.
    pub go_to: Option<String>,
    /// The box that asks what to open.
    pub open: Option<OpenBox>,
    /// A box was opened in this frame: it gets the keys.
    pub focus: bool,
    /// Why what was typed is none.
    refused: Option<String>,
}

/// What was typed into boxes, and where the list of keys lies.
#[derive(Default)]
pub struct BoxRequests {
    /// Coordinates to go to, as typed: E, N and perhaps U, of the files.
    pub go_to: Option<(f64, f64, Option<f64>)>,
    /// What to open.
    pub open: Option<OpenRequest>,
    /// The rectangle of the list of keys, and whether all of it is in sight.
    pub keys: Option<(egui::Rect, bool)>,
}

impl Boxes {
    /// Whether a box waits for words.
    pub fn is_typing(&self) -> bool {
        self.go_to.is_some() || self.open.is_some()
    }

    /// Closes them.
    pub fn close(&mut self) {
        *self = Boxes::default();
    }

    /// Lays out those that are open. `is_more`: something is open already; `places`: where what can be clicked lies.
    pub fn show(
        &mut self,
        context: &egui::Context,
        is_more: bool,
        places: &mut Vec<(String, egui::Pos2)>,
    ) -> BoxRequests {
        let mut requests = BoxRequests::default();
        let focus = std::mem::take(&mut self.focus);
        if let Some(text) = &mut self.go_to {
            let mut is_done = false;
            boxed("Go to").show(context, |ui| {
                let edit =
                    ui.add(TextEdit::singleline(text).hint_text("E, N or E, N, U").desired_width(320.0));
                if focus {
                    edit.request_focus();
                }
                is_done = is_entered(&edit, ui);
                if let Some(refused) = &self.refused {
                    ui.label(RichText::new(refused).color(WARN).small());
                }
            });
            match is_done.then(|| typed(text)) {
                Some(Ok(place)) => {
                    requests.go_to = Some(place);
                    self.close();
                }
                Some(Err(why)) => (self.refused, self.focus) = (Some(why), true),
                None => {}
            }
        }
        if let Some(open) = &mut self.open {
            let mut said = None;
            let refused = self.refused.as_deref();
            boxed("Open").show(context, |ui| said = open.show(ui, (focus, is_more), refused, places));
            match said.map(|instead| (inputs(&open.text), instead)) {
                Some((Ok(inputs), instead)) => {
                    requests.open = Some(OpenRequest { inputs, instead });
                    self.close();
                }
                Some((Err(why), _)) => (self.refused, self.focus) = (Some(why), true),
                None => {}
            }
        }
        if self.has_keys {
            requests.keys = keys(context);
        }
        requests
    }
}

fn is_entered(edit: &Response, ui: &Ui) -> bool {
    edit.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter))
}

/// The list of keys; gives its rectangle, and whether all of it is in sight.
fn keys(context: &egui::Context) -> Option<(egui::Rect, bool)> {
    let room = context.content_rect().height() - 60.0;
    let shown = boxed("Keys").show(context, |ui| {
        ui.spacing_mut().interact_size.y = 0.0;
        let list = ScrollArea::vertical().max_height(room).min_scrolled_height(room).show(ui, |ui| {
            egui::Grid::new("keys").spacing(vec2(20.0, 2.0)).show(ui, |ui| {
                for (keys, what) in KEYS {
                    ui.label(RichText::new(keys).strong());
                    ui.label(what);
                    ui.end_row();
                }
            });
        });
        list.content_size.y <= list.inner_rect.height() + 0.5
    })?;
    Some((shown.response.rect, shown.inner?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_typed_in_many_ways() {
        assert_eq!(typed("512000, 5402900"), Ok((512000.0, 5402900.0, None)));
        assert_eq!(typed("1;2;3"), Ok((1.0, 2.0, Some(3.0))));
        assert_eq!(typed("1.5 -2"), Ok((1.5, -2.0, None)));
        assert!(typed("12").is_err() && typed("a,b").is_err() && typed("1,inf").is_err());
    }

    #[test]
    fn paths_are_typed_with_spaces_or_in_quotes_and_go_on_by_themselves() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name).to_str().unwrap().to_owned();
        for name in ["a b.las", "tile1.LAZ", "tile2.laz", "notes.txt", "view.json", ".hidden.las"] {
            std::fs::write(at(name), "").unwrap();
        }
        std::fs::create_dir(at("tiles")).unwrap();
        let one = |word: String| Ok(vec![OsString::from(word)]);
        assert_eq!(inputs(&format!("  {} ", at("a b.las"))), one(at("a b.las")));
        assert_eq!(inputs(&at("*.laz")), one(at("*.laz")));
        let two = format!("'{}' \"{}\"", at("a b.las"), at("tiles"));
        assert_eq!(inputs(&two), Ok(vec![at("a b.las").into(), at("tiles").into()]));
        let missing = inputs(&at("no such")).unwrap_err();
        assert_eq!(missing, format!("{}: no such file or folder", at("no such")));
        assert!(inputs(" ").is_err());
        let all = offered(&at(""));
        let names = ["a b.las", "tile1.LAZ", "tile2.laz", "tiles/", "view.json"].map(&at);
        assert_eq!(all, names);
        let tiles = offered(&at("ti"));
        assert_eq!(shared_start(&tiles), at("tile"));
        assert_eq!(shared_start(&offered(&at("tiles"))), at("tiles/"));
        assert_eq!(shared_start(&offered(&at("x"))), "");
    }
}
