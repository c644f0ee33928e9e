//! Lines and cells of a table.

pub(super) fn is_comment(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    text.is_empty() || text.starts_with(b"#") || text.starts_with(b"sep=")
}

/// The most frequent separator of the header.
pub(super) fn cell_separator(header: &str) -> char {
    [',', ';', '\t'].into_iter().max_by_key(|&cell_separator| header.matches(cell_separator).count()).unwrap_or(',')
}

pub(super) fn trimmed_cell(value: &str) -> &str {
    value.trim_start_matches('\u{feff}').trim().trim_matches('"').trim()
}
