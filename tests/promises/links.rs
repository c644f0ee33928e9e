//! Links of the documents.

use std::path::Path;

use testkit::documents::{document_text, repository_root};

/// Text outside of code blocks.
fn prose(document: &str) -> String {
    document_text(document).split("```").step_by(2).collect()
}

/// A heading as the address of its section: lower case, hyphens for spaces, no punctuation.
fn anchor(heading: &str) -> String {
    let heading = heading.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
    heading.chars().filter(|character| character.is_alphanumeric() || "-_".contains(*character)).collect()
}

#[test]
fn links_lead_to_files_and_headings_that_exist() {
    let mut documents = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(str::to_owned).to_vec();
    let paths = repository_root().join("docs").read_dir().unwrap().map(|entry| entry.unwrap().path());
    for path in paths.filter(|path| path.extension().is_some_and(|extension| extension == "md")) {
        documents.push(format!("docs/{}", path.file_name().unwrap().display()));
    }
    let mut link_count = 0;
    for document in &documents {
        let text = prose(document);
        for link in text.split("](").skip(1).filter_map(|after| after.split(')').next()) {
            let (file, section) = link.split_once('#').unwrap_or((link, ""));
            if file.starts_with("https:") {
                continue;
            }
            let folder = Path::new(document).parent().unwrap();
            let target = if file.is_empty() { document.into() } else { folder.join(file) };
            assert!(repository_root().join(&target).exists(), "{document}: {link}");
            let has_section = || {
                let target = prose(target.to_str().unwrap());
                target.lines().any(|line| line.starts_with('#') && anchor(line) == section)
            };
            assert!(section.is_empty() || has_section(), "{document}: {link}");
            link_count += 1;
        }
    }
    assert!(link_count > 50, "{link_count}");
}
