//! Documents, and figures that they state and tests measure.

use std::path::{Path, PathBuf};

/// The project's root.
#[must_use]
pub fn repository_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Text of a document, by its path from the project's root.
///
/// # Panics
///
/// If it cannot be read.
#[must_use]
pub fn document_text(document: &str) -> String {
    std::fs::read_to_string(repository_root().join(document)).unwrap_or_else(|error| panic!("{document}: {error}"))
}

/// Asserts that the last cell of a table's row is `measured`.
///
/// `document` is a path from the project's root; `row` is the text of the row's other cells, from its start on.
///
/// # Panics
///
/// If the document states another figure, or lacks the row.
pub fn assert_document_states(document: &str, row: &str, measured: &str) {
    let text = document_text(document);
    let start = format!("| {row}");
    let stated_row =
        text.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("{document}: no row {row:?}"));
    let stated = stated_row.trim_end_matches(['|', ' ']).rsplit('|').next().unwrap_or_default().trim();
    assert!(stated == measured, "{document}, row {row:?}: it states {stated}, measured is {measured}");
}

/// Asserts that a generated document is `text`; writes it instead if the environment has `AUTOSWING_RECORD`.
///
/// # Panics
///
/// If the document has another text.
pub fn assert_document_is(document: &str, text: &str) {
    if std::env::var_os("AUTOSWING_RECORD").is_some() {
        std::fs::write(repository_root().join(document), text).unwrap_or_else(|error| panic!("{document}: {error}"));
    }
    assert!(document_text(document) == text, "{document} is out of date; AUTOSWING_RECORD=1 cargo test writes it");
}
