//! The library's dependencies follow the layers in docs/architecture.md: a module uses only modules of lower layers.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Layer number of each module, parsed from the diagram: a number followed by module names.
fn floors() -> BTreeMap<String, u32> {
    let text = fs::read_to_string(root().join("docs/architecture.md")).expect("docs/architecture.md");
    let drawing = text.split("```text").nth(1).and_then(|rest| rest.split("```").next()).expect("a drawing");
    let mut floors = BTreeMap::new();
    for line in drawing.lines() {
        let Some((number, rest)) = line.trim().split_once("  ") else { continue };
        let Ok(floor) = number.parse() else { continue };
        // Names are separated by two spaces; three or more precede the description.
        let names = rest.split("   ").next().unwrap_or_default();
        floors.extend(names.split_whitespace().map(|name| (name.to_owned(), floor)));
    }
    floors
}

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let is_test = path.file_stem().is_some_and(|name| name == "tests" || name == "testing");
        if path.is_dir() && !is_test {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") && !is_test {
            found.push(path);
        }
    }
}

/// Modules that a file uses (after `crate::` and `autoswing::`), without comments and unit tests.
fn used(text: &str, rooms: &BTreeMap<String, u32>) -> Vec<String> {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    code.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .flat_map(|line| ["crate::", "autoswing::"].map(|root| line.split(root).skip(1).collect::<Vec<_>>()).concat())
        .map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>())
        .filter(|name| rooms.contains_key(name))
        .collect()
}

#[test]
fn every_room_uses_only_what_is_below_it() {
    let floors = floors();
    let source = root().join("src");
    let mut files = Vec::new();
    rust_files(&source, &mut files);
    let mut seen = BTreeMap::new();
    for file in &files {
        let inside = file.strip_prefix(&source).expect("below src");
        let room = inside.components().next().expect("a name").as_os_str().to_string_lossy().replace(".rs", "");
        if room == "lib" {
            continue;
        }
        let floor = *floors.get(&room).unwrap_or_else(|| panic!("{room} is not in the drawing"));
        *seen.entry(room.clone()).or_insert(0) += 1;
        for other in used(&fs::read_to_string(file).expect("a file"), &floors) {
            assert!(other == room || floors[&other] < floor, "{}: {room} uses {other}", inside.display());
        }
    }
    let drawn: Vec<_> = floors.keys().collect();
    assert_eq!(seen.keys().collect::<Vec<_>>(), drawn, "rooms that are built and rooms that are drawn");
}
