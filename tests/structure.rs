//! The house: files import downward, without circles.
//!
//! What a file imports is what its `use` declarations and paths name, followed through aliases and re-exports to the file
//! that defines it, and whatever else is written `crate::…`, in macros and attributes; tests within a file may look anywhere.
//! A `mod.rs` imports nothing by passing on what its own children define.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::visit::Visit;

/// Top-level modules, from the ground up: each may import those before it.
const FLOORS: [&str; 22] = [
    "shared",
    "limits",
    "text",
    "stop",
    "coords",
    "attribute",
    "source",
    "output",
    "problems",
    "sample",
    "section",
    "ground",
    "ingest",
    "gpu",
    "resident",
    "render",
    "synth",
    "load",
    "bench",
    "view",
    "command",
    "cli",
];

type Module = Vec<String>;

/// Every module of the library and its file.
fn modules() -> BTreeMap<Module, PathBuf> {
    fn walk(folder: &Path, path: &[String], found: &mut BTreeMap<Module, PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("the sources are here").flatten() {
            let file = entry.path();
            let name = file.file_stem().expect("a file has a name").to_string_lossy().into_owned();
            if file.is_dir() {
                walk(&file, &[path, &[name]].concat(), found);
            } else if file.extension().is_some_and(|e| e == "rs") && name != "main" {
                let is_folder = name == "mod" || name == "lib";
                found.insert(if is_folder { path.to_vec() } else { [path, &[name]].concat() }, file);
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &[], &mut found);
    found
}

/// What one file names.
struct Names<'a> {
    module: &'a Module,
    modules: &'a BTreeMap<Module, PathBuf>,
    /// Paths from the crate's root that it uses.
    used: Vec<Module>,
    /// What it passes on, by the name it has here.
    passed_on: Vec<(String, Module)>,
    /// What its `use` declarations call by a name of its own.
    aliases: BTreeMap<String, Module>,
    /// Paths as they are written.
    written: Vec<Vec<String>>,
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|a| {
        a.path().is_ident("test")
            || a.path().is_ident("cfg") && a.parse_args::<syn::Ident>().is_ok_and(|ident| ident == "test")
    })
}

impl Names<'_> {
    /// From the crate's root; `None`: it is no path of this crate.
    fn absolute(&self, path: &[String]) -> Option<Module> {
        let (first, rest) = path.split_first()?;
        let mut base = self.module.clone();
        match first.as_str() {
            "crate" => return Some(rest.to_vec()),
            "self" => return Some([base, rest.to_vec()].concat()),
            "super" => {
                base.pop()?;
                let ups = rest.iter().take_while(|name| *name == "super").count();
                base.truncate(base.len().checked_sub(ups)?);
                return Some([base, rest[ups..].to_vec()].concat());
            }
            child => base.push(child.to_owned()),
        }
        self.modules.contains_key(&base).then(|| [base, rest.to_vec()].concat())
    }

    fn tree(&mut self, tree: &syn::UseTree, before: &[String], is_public: bool) {
        let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        let (path, name) = match tree {
            syn::UseTree::Path(path) => return self.tree(&path.tree, &with(&path.ident), is_public),
            syn::UseTree::Group(group) => {
                return group.items.iter().for_each(|tree| self.tree(tree, before, is_public));
            }
            syn::UseTree::Name(name) if name.ident == "self" => (before.to_vec(), before.last().cloned()),
            syn::UseTree::Name(name) => (with(&name.ident), Some(name.ident.to_string())),
            syn::UseTree::Rename(rename) => (with(&rename.ident), Some(rename.rename.to_string())),
            syn::UseTree::Glob(_) => (before.to_vec(), None),
        };
        let Some(path) = self.absolute(&path) else { return };
        let is_own_child = path.len() > self.module.len() + 1 && path.starts_with(self.module);
        if let Some(name) = name {
            self.aliases.insert(name.clone(), path.clone());
            if is_public {
                self.passed_on.push((name, path.clone()));
            }
        }
        if !(is_public && is_own_child) {
            self.used.push(path);
        }
    }

    /// Paths through names that are known by now.
    fn resolve(&mut self) {
        for path in std::mem::take(&mut self.written) {
            let (first, rest) = path.split_first().expect("paths have a first name");
            let through = self.aliases.get(first).map(|alias| [&alias[..], rest].concat());
            self.used.extend(through.or_else(|| self.absolute(&path)));
        }
    }

    /// Whatever is written `crate::…` before the tests, comments apart.
    fn scan(&mut self, text: &str) {
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        for line in code.lines().map(|line| line.split("//").next().unwrap_or_default()) {
            for path in line.split("crate::").skip(1) {
                let end =
                    path.find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':').unwrap_or(path.len());
                let names = path[..end].split("::").filter(|name| !name.is_empty());
                self.used.push(names.map(str::to_owned).collect());
            }
        }
    }
}

impl<'ast> Visit<'ast> for Names<'_> {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        let attributes = match item {
            syn::Item::Mod(item) => &item.attrs,
            syn::Item::Fn(item) => &item.attrs,
            syn::Item::Use(item) => &item.attrs,
            syn::Item::Impl(item) => &item.attrs,
            _ => &Vec::new(),
        };
        if !is_test(attributes) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        if !is_test(&function.attrs) {
            syn::visit::visit_impl_item_fn(self, function);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.tree(&item.tree, &[], !matches!(item.vis, syn::Visibility::Inherited));
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names: Vec<_> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        if names.len() > 1 {
            self.written.push(names);
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, macro_: &'ast syn::Macro) {
        // Arguments of macros are no paths yet; those of the usual ones are expressions.
        let parser = syn::punctuated::Punctuated::<syn::Expr, syn::Token![,]>::parse_terminated;
        if let Ok(arguments) = macro_.parse_body_with(parser) {
            arguments.iter().for_each(|argument| self.visit_expr(argument));
        }
        syn::visit::visit_macro(self, macro_);
    }
}

/// Which modules each module imports.
fn imports() -> BTreeMap<Module, BTreeSet<Module>> {
    let modules = modules();
    let (mut used, mut passed_on) = (BTreeMap::new(), BTreeMap::new());
    for (module, file) in &modules {
        let text = std::fs::read_to_string(file).expect("a source is text");
        let parsed = syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let mut names = Names {
            module,
            modules: &modules,
            used: Vec::new(),
            passed_on: Vec::new(),
            aliases: BTreeMap::new(),
            written: Vec::new(),
        };
        names.visit_file(&parsed);
        names.resolve();
        names.scan(&text);
        for (name, path) in names.passed_on {
            passed_on.insert([&module[..], &[name]].concat(), path);
        }
        used.insert(module.clone(), names.used);
    }
    // The file that defines what a path names.
    let owner = |path: &Module| -> Module {
        let mut path = path.clone();
        for _ in 0..16 {
            let longest = (1..=path.len()).rev().find_map(|n| {
                let next = passed_on.get(&path[..n]).filter(|_| !modules.contains_key(&path[..n]))?;
                Some([&next[..], &path[n..]].concat())
            });
            let Some(next) = longest else { break };
            path = next;
        }
        let n = (0..=path.len()).rev().find(|&n| modules.contains_key(&path[..n])).unwrap_or(0);
        path.truncate(n);
        path
    };
    used.into_iter()
        .map(|(module, paths)| {
            let owners = paths.iter().map(owner).filter(|owner| *owner != module).collect();
            (module, owners)
        })
        .collect()
}

/// Modules that import each other, directly or not; empty: there is no circle.
fn circle(imports: &BTreeMap<Module, BTreeSet<Module>>) -> Vec<String> {
    // Whoever imports nothing that is left goes, until nobody can.
    let mut left: BTreeMap<_, BTreeSet<_>> = imports.clone();
    loop {
        let free: Vec<_> = left.iter().filter(|(_, of)| of.is_empty()).map(|(m, _)| m.clone()).collect();
        if free.is_empty() {
            break;
        }
        for module in free {
            left.remove(&module);
            left.values_mut().for_each(|of| {
                of.remove(&module);
            });
        }
    }
    // And whom nobody that is left imports.
    loop {
        let named: BTreeSet<_> = left.values().flatten().cloned().collect();
        let before = left.len();
        left.retain(|module, _| named.contains(module));
        if left.len() == before {
            break;
        }
    }
    let line = |(module, of): (&Module, &BTreeSet<Module>)| {
        let of: Vec<_> = of.iter().map(|m| m.join("::")).collect();
        format!("{} imports {}", module.join("::"), of.join(", "))
    };
    left.iter().map(line).collect()
}

#[test]
fn files_import_downward_without_circles() {
    let imports = imports();
    assert!(imports.len() > 100, "the sources are read");
    // It does find what is imported.
    let of = |module: &str| &imports[&module.split("::").map(str::to_owned).collect::<Vec<_>>()];
    assert!(of("resident::live").contains(&vec!["ingest".to_owned(), "feed".to_owned()]));
    let circle = circle(&imports);
    assert!(circle.is_empty(), "files import each other:\n{}", circle.join("\n"));
}

#[test]
fn floors_stand_on_those_below() {
    let floor = |name: &str| FLOORS.iter().position(|floor| *floor == name);
    for (module, of) in imports() {
        let Some(own) = module.first() else { continue };
        let height = floor(own).unwrap_or_else(|| panic!("{own} has no floor"));
        for other in of.iter().filter_map(|other| other.first()).filter(|other| *other != own) {
            assert!(
                floor(other).is_some_and(|below| below < height),
                "{} imports {other}",
                module.join("::")
            );
        }
    }
}

#[test]
fn a_circle_is_found() {
    let module = |name: &str| vec![name.to_owned()];
    let edges = |list: &[(&str, &[&str])]| -> BTreeMap<Module, BTreeSet<Module>> {
        list.iter().map(|(of, to)| (module(of), to.iter().map(|to| module(to)).collect())).collect()
    };
    assert!(circle(&edges(&[("a", &["b", "c"]), ("b", &["c"]), ("c", &[])])).is_empty());
    let found = circle(&edges(&[("a", &["b"]), ("b", &["c"]), ("c", &["b", "d"]), ("d", &[])]));
    assert_eq!(found, ["b imports c", "c imports b"]);
}
