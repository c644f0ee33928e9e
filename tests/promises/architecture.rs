//! Imports follow docs/architecture.md. Between the rooms of the packages in `src/` they point to a lower floor. Inside
//! every folder of these and of the host's packages, an arrow leads from one file or subfolder (a room) to another if it
//! names an item of it, re-exports resolved: arrows form no circle, and no room names an item of its own folder's
//! `mod.rs`, which stands above it, or an item by the re-export there.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use syn::visit::{self, Visit};
use syn::{Item, UseTree};
use testkit::documents::{document_text, repository_root};

/// Path of a module or item from the crate's root.
type ModulePath = Vec<String>;

/// Source folders of the module's packages.
const MODULE_FOLDERS: [&str; 3] = ["src/library", "src/module", "src/firmware"];

/// Source folders of all packages.
const SOURCE_FOLDERS: [&str; 9] = [
    MODULE_FOLDERS[0],
    MODULE_FOLDERS[1],
    MODULE_FOLDERS[2],
    "host-sim/testkit/src",
    "host-sim/log-analysis/src",
    "host-sim/simulator/src",
    "host-sim/web/src",
    "host-sim/src",
    "host-sim/laboratory/src",
];

/// A crate's modules without unit tests: which items they define, which names they import, and which paths they use.
#[derive(Default)]
struct Crate {
    modules: BTreeSet<ModulePath>,
    items: BTreeSet<ModulePath>,
    /// Path of an imported name, and the path of its item.
    imports: BTreeMap<ModulePath, ModulePath>,
    /// Modules whose every item a module imports.
    glob_imports: BTreeMap<ModulePath, Vec<ModulePath>>,
    /// Module and the path that it uses.
    used_paths: BTreeSet<(ModulePath, ModulePath)>,
}

/// Arrows between the rooms of one folder.
#[derive(Default)]
struct Folder {
    rooms: BTreeSet<String>,
    arrows: BTreeSet<(String, String)>,
    /// Rooms that name an item of the folder's `mod.rs`, or by a re-export there.
    upward_rooms: BTreeSet<String>,
}

impl Crate {
    /// Parses all files below the crate's source folder, unit tests and binaries excluded.
    fn parse(source: &Path) -> Self {
        let mut parsed = Self::default();
        let mut files = Vec::new();
        rust_files(source, &mut files);
        let files: Vec<_> = files
            .into_iter()
            .filter_map(|file| {
                let inside = file.strip_prefix(source).expect("below the source").with_extension("");
                let mut module: ModulePath =
                    inside.iter().map(|component| component.to_str().expect("a name in UTF-8").to_owned()).collect();
                if module.last().is_some_and(|last| last == "mod") || module == ["lib"] {
                    module.pop();
                }
                let text = fs::read_to_string(&file).expect("a file");
                (module != ["main"]).then(|| (module, syn::parse_file(&text).expect("Rust")))
            })
            .collect();
        parsed.modules = files.iter().map(|(module, _)| module.clone()).collect();
        for (module, file) in &files {
            ModuleVisitor { module: module.clone(), parsed: &mut parsed }.visit_file(file);
        }
        parsed
    }

    /// Path from the root of a path written in `module`; `None` for other crates.
    fn absolute_path(&self, module: &[String], written_path: &[String]) -> Option<ModulePath> {
        let mut base = module.to_vec();
        let mut remaining = written_path;
        match remaining.first()?.as_str() {
            "crate" => (base, remaining) = (Vec::new(), &remaining[1..]),
            "self" => remaining = &remaining[1..],
            "super" => {
                while remaining.first().is_some_and(|first| first == "super") {
                    base.pop()?;
                    remaining = &remaining[1..];
                }
            }
            first => {
                let child = [module, &[first.to_owned()]].concat();
                if !self.modules.contains(&child) {
                    return None;
                }
            }
        }
        base.extend_from_slice(remaining);
        Some(base)
    }

    /// Module that defines what a path from the root names.
    fn defining_module(&self, path: &[String], depth: u32) -> ModulePath {
        assert!(depth < 20, "{path:?} is imported in a circle");
        let module_length = (0..=path.len()).rev().find(|&length| self.modules.contains(&path[..length])).unwrap_or(0);
        let (module, item_path) = path.split_at(module_length);
        let Some(name) = item_path.first() else { return module.to_vec() };
        let item = [module, std::slice::from_ref(name)].concat();
        if let Some(target) = self.imports.get(&item).filter(|target| **target != item) {
            return self.defining_module(&[target.clone(), item_path[1..].to_vec()].concat(), depth + 1);
        }
        if !self.items.contains(&item)
            && let Some(from) = self
                .glob_imports
                .get(module)
                .into_iter()
                .flatten()
                .find(|from| self.items.contains(&[from.as_slice(), std::slice::from_ref(name)].concat()))
        {
            return self.defining_module(&[from.clone(), item_path.to_vec()].concat(), depth + 1);
        }
        module.to_vec()
    }

    /// Folder above `module` whose `mod.rs` imports what `path` names, and the room of the folder that contains `module`.
    fn reexport_above<'a>(&self, module: &'a [String], path: &[String]) -> Option<(&'a [String], &'a String)> {
        (1..module.len().min(path.len()))
            .find(|&length| module[..length] == path[..length] && self.imports.contains_key(&path[..=length]))
            .map(|length| (&module[..length], &module[length]))
    }

    /// Folders of the crate, by path.
    fn folders(&self) -> BTreeMap<String, Folder> {
        let mut folders: BTreeMap<String, Folder> = BTreeMap::new();
        for module in self.modules.iter().filter(|module| !module.is_empty()) {
            let (name, folder) = module.split_last().expect("a name");
            folders.entry(folder.join("/")).or_default().rooms.insert(name.clone());
        }
        for (module, path) in &self.used_paths {
            if let Some((folder, room)) = self.reexport_above(module, path) {
                folders.entry(folder.join("/")).or_default().upward_rooms.insert(room.clone());
            }
            let target = self.defining_module(path, 0);
            let shared = module.iter().zip(&target).take_while(|(from, to)| from == to).count();
            let folder = folders.entry(module[..shared].join("/")).or_default();
            match (module.get(shared), target.get(shared)) {
                (Some(from), Some(to)) => {
                    folder.arrows.insert((from.clone(), to.clone()));
                }
                (Some(from), None) => {
                    folder.upward_rooms.insert(from.clone());
                }
                // `mod.rs` names an item of a room, which is allowed.
                (None, _) => {}
            }
        }
        folders
    }
}

impl Folder {
    /// Rooms from which arrows lead back to themselves.
    fn rooms_in_cycles(&self) -> BTreeSet<&String> {
        self.rooms.iter().filter(|room| self.rooms_reached_from(room).contains(*room)).collect()
    }

    fn rooms_reached_from<'a>(&'a self, start: &'a str) -> BTreeSet<&'a String> {
        let mut reached = BTreeSet::new();
        let mut open = vec![start];
        while let Some(room) = open.pop() {
            let next = self.arrows.iter().filter(|(from, _)| from == room).map(|(_, to)| to);
            open.extend(next.filter(|to| reached.insert(*to)).map(String::as_str));
        }
        reached
    }
}

struct ModuleVisitor<'a> {
    module: ModulePath,
    parsed: &'a mut Crate,
}

impl ModuleVisitor<'_> {
    fn record_import(&mut self, parent_path: &ModulePath, tree: &UseTree) {
        let with = |name: &syn::Ident| [parent_path.clone(), vec![name.to_string()]].concat();
        match tree {
            UseTree::Path(path) => self.record_import(&with(&path.ident), &path.tree),
            UseTree::Group(group) => group.items.iter().for_each(|item| self.record_import(parent_path, item)),
            UseTree::Name(name) if name.ident == "self" => self.record_name(parent_path, parent_path.last().cloned()),
            UseTree::Name(name) => self.record_name(&with(&name.ident), Some(name.ident.to_string())),
            UseTree::Rename(rename) => self.record_name(&with(&rename.ident), Some(rename.rename.to_string())),
            UseTree::Glob(_) => {
                if let Some(target) = self.parsed.absolute_path(&self.module, parent_path) {
                    self.parsed.used_paths.insert((self.module.clone(), target.clone()));
                    self.parsed.glob_imports.entry(self.module.clone()).or_default().push(target);
                }
            }
        }
    }

    fn record_name(&mut self, written: &ModulePath, name: Option<String>) {
        let (Some(target), Some(name)) = (self.parsed.absolute_path(&self.module, written), name) else { return };
        self.parsed.used_paths.insert((self.module.clone(), target.clone()));
        self.parsed.imports.insert([self.module.clone(), vec![name]].concat(), target);
    }

    fn record_used_path(&mut self, written: &ModulePath) {
        if written.len() > 1
            && let Some(target) = self.parsed.absolute_path(&self.module, written)
        {
            self.parsed.used_paths.insert((self.module.clone(), target));
        }
    }
}

impl<'a> Visit<'a> for ModuleVisitor<'_> {
    fn visit_item(&mut self, item: &'a Item) {
        let (attributes, name) = match item {
            Item::Const(item) => (&item.attrs, Some(&item.ident)),
            Item::Enum(item) => (&item.attrs, Some(&item.ident)),
            Item::Fn(item) => (&item.attrs, Some(&item.sig.ident)),
            Item::Static(item) => (&item.attrs, Some(&item.ident)),
            Item::Struct(item) => (&item.attrs, Some(&item.ident)),
            Item::Trait(item) => (&item.attrs, Some(&item.ident)),
            Item::Type(item) => (&item.attrs, Some(&item.ident)),
            Item::Impl(item) => (&item.attrs, None),
            Item::Mod(item) => (&item.attrs, None),
            Item::Use(item) => (&item.attrs, None),
            _ => return,
        };
        let is_test = |attribute: &syn::Attribute| {
            attribute.path().is_ident("cfg")
                && attribute.parse_args::<syn::Path>().is_ok_and(|cfg| cfg.is_ident("test"))
        };
        if attributes.iter().any(is_test) {
            return;
        }
        if let Some(name) = name {
            self.parsed.items.insert([self.module.clone(), vec![name.to_string()]].concat());
        }
        match item {
            Item::Use(item) => self.record_import(&Vec::new(), &item.tree),
            _ => visit::visit_item(self, item),
        }
    }

    /// The scope of a visibility is no use of the module that it names.
    fn visit_visibility(&mut self, _: &'a syn::Visibility) {}

    fn visit_path(&mut self, path: &'a syn::Path) {
        let written: ModulePath = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.record_used_path(&written);
        visit::visit_path(self, path);
    }

    /// The input of a macro is not parsed: its paths are found in its text.
    fn visit_macro(&mut self, call: &'a syn::Macro) {
        let input = call.tokens.to_string().replace(" :: ", "::");
        for written in input.split(|character: char| !(character.is_alphanumeric() || "_:".contains(character))) {
            self.record_used_path(&written.split("::").map(str::to_owned).collect::<ModulePath>());
        }
        visit::visit_macro(self, call);
    }
}

fn rust_files(folder: &Path, paths: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.file_stem().is_some_and(|name| {
            ["tests", "help_tests", "testing", "bin", "examples", "build"].iter().any(|skipped| name == *skipped)
        }) {
            continue;
        }
        if path.is_dir() {
            rust_files(&path, paths);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            paths.push(path);
        }
    }
}

/// Floor of each room, parsed from the diagram: a number followed by names.
fn parse_floors() -> BTreeMap<String, u32> {
    let text = document_text("docs/architecture.md");
    let diagram =
        text.split("```text").nth(1).and_then(|after_fence| after_fence.split("```").next()).expect("a diagram");
    let mut floors = BTreeMap::new();
    for line in diagram.lines() {
        let Some((floor_number, after_fence)) = line.trim().split_once("  ") else { continue };
        let Ok(floor) = floor_number.parse() else { continue };
        // Names are separated by two spaces; three or more precede the description.
        let names = after_fence.split("   ").next().unwrap_or_default();
        floors.extend(names.split_whitespace().map(|name| (name.to_owned(), floor)));
    }
    floors
}

/// Folders of each package, parsed once, because that takes seconds.
static PACKAGE_FOLDERS: LazyLock<BTreeMap<&str, BTreeMap<String, Folder>>> = LazyLock::new(|| {
    SOURCE_FOLDERS.map(|source| (source, Crate::parse(&repository_root().join(source)).folders())).into()
});

#[test]
fn rooms_of_the_module_use_only_lower_floors() {
    let floors = parse_floors();
    let mut rooms = BTreeSet::new();
    for package in MODULE_FOLDERS {
        let folder = &PACKAGE_FOLDERS[package][""];
        for (from, to) in &folder.arrows {
            assert!(floors[to] < floors[from], "{from} uses {to}");
        }
        rooms.extend(folder.rooms.clone());
    }
    let documented_rooms: BTreeSet<_> = floors.into_keys().filter(|name| name != "main").collect();
    assert_eq!(rooms, documented_rooms, "rooms that exist and rooms in the diagram");
}

/// With `--nocapture`: rooms and arrows of each folder.
#[test]
fn arrows_in_a_folder_lead_neither_up_nor_in_circles() {
    let mut wrong = Vec::new();
    for (source, folders) in PACKAGE_FOLDERS.iter() {
        for (path, folder) in folders {
            let path = if path.is_empty() { (*source).to_owned() } else { format!("{source}/{path}") };
            let circles = folder.rooms_in_cycles();
            println!(
                "{path}: {} rooms, {} arrows, {} rooms use mod.rs, {} on circles",
                folder.rooms.len(),
                folder.arrows.len(),
                folder.upward_rooms.len(),
                circles.len()
            );
            if !folder.upward_rooms.is_empty() || !circles.is_empty() {
                wrong.push(format!("{path}: use mod.rs: {:?}, on circles: {circles:?}", folder.upward_rooms));
            }
        }
    }
    assert!(wrong.is_empty(), "rooms with arrows back:\n{}", wrong.join("\n"));
}
