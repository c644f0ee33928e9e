//! Assembles the HTML page.

use super::model::Report;
use super::sections;
use super::svg::style_css;
use super::text::{concat_map, escape_html};

const STYLE: &str = include_str!("assets/page.css");
const SCRIPT: &str = concat!(
    include_str!("assets/copy.js"),
    "/*\n",
    include_str!("assets/uplot/LICENSE"),
    "*/\n",
    include_str!("assets/uplot/uPlot.iife.min.js"),
    include_str!("assets/charts.js")
);
const CHART_STYLE: &str = include_str!("assets/uplot/uPlot.min.css");

/// Content security policy: inline style, this script by its checksum, no network. scripts/page fails if the checksum
/// is outdated.
const CONTENT_SECURITY_POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-d5hd00+SZq8vT+T90fXwN1Vq3AGkdaX1WmReUl90cgY='";

pub fn render_html(report: &Report) -> String {
    let parts = page_sections(report);
    let links = concat_map(&parts, |page_section| {
        format!("<li><a href=\"#{}\">{}</a></li>", page_section.id, escape_html(&page_section.title))
    });
    let sections_html = concat_map(&parts, |page_section| {
        let (id, title) = (&page_section.id, escape_html(&page_section.title));
        let heading = format!("<h2 id=\"{id}\">{title}</h2>");
        let content = if page_section.is_folded {
            format!("<details><summary>{heading}</summary>\n{}</details>\n", page_section.html)
        } else {
            format!("{heading}\n{}", page_section.html)
        };
        format!("<section aria-labelledby=\"{id}\">\n{content}</section>\n")
    });
    let title = escape_html(&report.title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{CONTENT_SECURITY_POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} - Autoswing</title>\n\
         <style>\n{}{CHART_STYLE}\n{STYLE}</style></head>\n<body>\n<a class=\"skip\" href=\"#verdict\">Skip to the verdict</a>\n\
         <header><p class=\"brand\">Autoswing</p><h1>{title}</h1></header>\n<main>\n{sections_html}</main>\n\
         <nav aria-label=\"Parts of the page\"><ul>{links}</ul></nav>\n<script>{SCRIPT}</script>\n</body></html>\n",
        style_css()
    )
}

struct PageSection {
    id: String,
    title: String,
    html: String,
    is_folded: bool,
}

fn page_sections(report: &Report) -> Vec<PageSection> {
    let open = |id: &str, title: &str, html: String| PageSection {
        id: id.to_owned(),
        title: title.to_owned(),
        html,
        is_folded: false,
    };
    let folded_section = |id: &str, title: &str, html: String| PageSection { is_folded: true, ..open(id, title, html) };
    let mut parts = vec![open("verdict", "Verdict", sections::verdict_section(report))];
    if let Some([name, text]) = report.parameter_file.as_ref().filter(|[_, text]| !text.is_empty()) {
        parts.push(open("parameters", "Parameters to load", sections::parameters_section(name, text)));
    }
    parts.push(open("findings", "Findings", sections::findings_section(report)));
    if !report.calibrators.calibrator_rows.is_empty() {
        parts.push(folded_section("compasses", "Compasses side by side", sections::comparison_section(report)));
    }
    for (i, compass) in report.compasses.iter().enumerate() {
        let id = format!("compass-{}", i + 1);
        parts.push(folded_section(
            &id,
            &compass.compass_name,
            sections::compass_section(&id, compass, &report.reference),
        ));
    }
    if let Some(map) = report.main_compass().and_then(sections::map_section) {
        parts.push(folded_section("map", "Map", map));
    }
    parts.push(folded_section("made", "How this was made", sections::origin_section(report)));
    parts
}
