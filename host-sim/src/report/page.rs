//! The page: head, the order of its parts, and what made it.

use super::model::Report;
use super::sections;
use super::svg::style;
use super::text::{each, escaped};

const STYLE: &str = include_str!("assets/page.css");
const SCRIPT: &str = include_str!("assets/copy.js");

/// What the browser may do with the page: use its own style and this very script, and ask nobody for anything. scripts/page
/// fails when the script has another checksum.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-z8uWZq3bMOHQkVibYXdVc3SUbaFWVdfGElziXV1G3Po='";

/// The whole page.
pub fn page(report: &Report) -> String {
    let parts = parts(report);
    let links = each(&parts, |part| format!("<li><a href=\"#{}\">{}</a></li>", part.id, escaped(&part.title)));
    let body = each(&parts, |part| {
        let (id, title) = (&part.id, escaped(&part.title));
        format!("<section aria-labelledby=\"{id}\">\n<h2 id=\"{id}\">{title}</h2>\n{}</section>\n", part.html)
    });
    let title = escaped(&report.title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} - Autoswing</title>\n\
         <style>\n{}{STYLE}</style></head>\n<body>\n<a class=\"skip\" href=\"#verdict\">Skip to the verdict</a>\n\
         <header><p class=\"brand\">Autoswing</p><h1>{title}</h1>\n<nav aria-label=\"Parts of the page\"><ul>{links}</ul></nav>\
         </header>\n<main>\n{body}</main>\n<script>{SCRIPT}</script>\n</body></html>\n",
        style()
    )
}

/// A part of the page.
struct Part {
    id: String,
    title: String,
    html: String,
}

fn parts(report: &Report) -> Vec<Part> {
    let part = |id: &str, title: &str, html: String| Part { id: id.to_owned(), title: title.to_owned(), html };
    let mut parts = vec![part("verdict", "Verdict", sections::verdict(report))];
    if !report.methods.rows.is_empty() {
        parts.push(part("compasses", "Compasses side by side", sections::methods(report)));
    }
    for (i, compass) in report.compasses.iter().enumerate() {
        let id = format!("compass-{}", i + 1);
        parts.push(part(&id, &compass.name, sections::compass(&id, compass, &report.compared)));
    }
    if let Some(map) = report.foremost().and_then(sections::map) {
        parts.push(part("map", "Map", map));
    }
    if let Some([name, text]) = report.parameters.as_ref().filter(|[_, text]| !text.is_empty()) {
        parts.push(part("parameters", "Parameters to load", sections::parameters(name, text)));
    }
    parts.push(part("made", "How this was made", sections::made(report)));
    parts
}
