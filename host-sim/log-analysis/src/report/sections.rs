//! Sections of the page.

use super::chart_samples::{has_samples, samples_json};
use super::deviation_picture::DeviationPicture;
use super::model::{CompassReport, DeviationCurve, ReferenceInfo, Report, ReportSample, VerdictLine};
use super::text::{concat_map, escape_html};
use crate::numbers::{format_number, format_optional};
use crate::replay::ParameterFile;
use crate::replay::verdict::CompassState;

/// Verdict on the first compass with its picture and what to do, then the others.
pub fn verdict_section(report: &Report) -> String {
    let mut lines = report.verdicts.iter().map(verdict_line);
    let first = lines.next().unwrap_or_default();
    let picture =
        report.compasses.first().filter(|compass| compass.has_curves()).map_or_else(String::new, |compass| {
            figure(&DeviationPicture::new(compass, report.reference.difference_name))
        });
    let steps = concat_map(&report.next_steps, |step| format!("<li>{}</li>\n", escape_html(step)));
    let steps = if steps.is_empty() { steps } else { format!("<h3>What to do</h3>\n<ol>\n{steps}</ol>\n") };
    let others: String = lines.collect();
    format!("{first}<div class=\"first\">\n{picture}<div>{}{steps}</div></div>\n{others}", parameter_files(report))
}

/// One download, one copy, and the files for other ground stations.
fn parameter_files(report: &Report) -> String {
    let link = |file: &ParameterFile, class: &str| {
        let (name, text) = (file.file_name, percent_encoded(&file.text));
        format!("<a{class} download=\"{name}\" href=\"data:text/plain;charset=utf-8,{text}\">Download {name}</a>")
    };
    let Some((main, others)) = report.parameter_files.split_first() else { return String::new() };
    let others = concat_map(others, |file| link(file, ""));
    let others = if others.is_empty() {
        others
    } else {
        format!("<details class=\"menu\"><summary>For QGroundControl</summary>{others}</details>")
    };
    format!(
        "<p class=\"actions\">{} <button type=\"button\" data-copy=\"parameters-text\" hidden>Copy</button> \
         <span role=\"status\" id=\"copied\"></span></p>\n{others}\n<p>{}</p>\n<pre id=\"parameters-text\" hidden>{}</pre>\n",
        link(main, " class=\"button\""),
        escape_html(&report.correction_choices),
        escape_html(&main.text)
    )
}

/// Old and new values of the parameters to load.
pub fn parameters_section(report: &Report) -> String {
    if report.parameter_changes.is_empty() {
        return String::new();
    }
    let rows = report.parameter_changes.iter().map(|change| {
        let logged = change
            .logged_value
            .filter(|value| value.is_finite())
            .map_or_else(|| "–".to_owned(), |value| value.to_string());
        (change.name.clone(), vec![logged, change.new_value.clone()])
    });
    html_table("Parameters of the autopilot", "", &["in the log", "to load"], rows)
}

/// Charts of each compass.
pub fn charts_section(report: &Report) -> String {
    if !report.compasses.iter().any(has_samples) {
        return String::new();
    }
    of_each_compass(report, |compass| {
        let figures = chart_figures(compass, report.reference.difference_name);
        figures + "<noscript><p>The charts need JavaScript.</p></noscript>\n"
    })
}

fn chart_figures(compass: &CompassReport, difference_name: &str) -> String {
    let figures = concat_map(charts(compass, difference_name), |(kind, title, description)| {
        let description = escape_html(&description);
        format!(
            "<figure><div class=\"chart\" data-chart=\"{kind}\" role=\"img\" aria-label=\"{title}: {description}\"></div>\
             <figcaption><b>{title}.</b> {description}</figcaption></figure>\n"
        )
    });
    // JSON in an HTML script must not contain "<", which could end the script.
    let json = samples_json(compass, difference_name).to_string().replace('<', "\\u003c");
    format!("<div class=\"charts\">\n<script type=\"application/json\">{json}</script>\n{figures}</div>\n")
}

/// Deviation cards, where the reference is accurate enough for one.
pub fn cards_section(report: &Report) -> String {
    if !report.reference.is_accurate || !report.compasses.iter().any(CompassReport::has_curves) {
        return String::new();
    }
    of_each_compass(report, |compass| deviation_card(compass, &report.reference))
}

/// A part of the page for each compass, of which `assets/compasses.js` shows the chosen one.
fn of_each_compass(report: &Report, html: impl Fn(&CompassReport) -> String) -> String {
    let several = report.compasses.len() > 1;
    concat_map(&report.compasses, |compass| {
        let heading =
            if several { format!("<h3>{}</h3>\n", escape_html(&compass.compass_name)) } else { String::new() };
        let name = escape_html(&compass.compass_name);
        let html = html(compass);
        format!("<div class=\"compass\" data-compass=\"{name}\">\n{heading}{html}</div>\n")
    })
}

/// Reference, warnings about the log, command, version and settings.
pub fn origin_section(report: &Report) -> String {
    let mut html = vec![facts_list(&report.origin)];
    if !report.reference.reference_name.is_empty() {
        html.push(format!(
            "<p>Compared with {}: {}.</p>\n",
            escape_html(&report.reference.reference_name),
            escape_html(&report.reference.accuracy_text),
        ));
    }
    if !report.log_warnings.is_empty() {
        let items = concat_map(&report.log_warnings, |warning| format!("<li>{}</li>\n", escape_html(warning)));
        html.push(format!("<ul>\n{items}</ul>\n"));
    }
    html.concat()
}

/// Key figures, the comparison of calibrators, and the facts about each compass.
pub fn figures_section(report: &Report) -> String {
    let mut html = vec![facts_list(&report.key_figures)];
    if !report.calibrators.calibrator_rows.is_empty() {
        html.push(comparison_table(report));
    }
    html.push(of_each_compass(report, |compass| facts_list(&compass.facts) + &coefficients_table(compass)));
    if let Some(session) = &report.console_session {
        html.push(format!(
            "<details class=\"terminal\"><summary>Console session</summary>\n{}</details>\n",
            html_listing("printed-text", "Console session", session)
        ));
    }
    html.concat()
}

fn facts_list(facts: &[[String; 2]]) -> String {
    let rows = concat_map(facts, |[label, value]| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape_html(label), escape_html(value))
    });
    if rows.is_empty() { rows } else { format!("<dl class=\"facts\">\n{rows}</dl>\n") }
}

fn coefficients_table(compass: &CompassReport) -> String {
    let Some([x, y, z, b]) = compass.coefficients else { return String::new() };
    let row = |name: &str, values: [f64; 3], decimals| {
        (name.to_owned(), values.iter().map(|value| format_number(*value, decimals)).collect())
    };
    let rows = [row("W, x", x, 5), row("W, y", y, 5), row("W, z", z, 5), row("b, uT", b, 3)];
    html_table("The module's coefficients: corrected field = W (m - b)", "", &["x", "y", "z"], rows.into_iter())
}

fn verdict_line(line: &VerdictLine) -> String {
    let (class, sign) = match line.compass_state {
        Some(CompassState::Good) => ("good", "✓"),
        Some(CompassState::Fair) => ("fair", "≈"),
        Some(CompassState::Bad) => ("bad", "✗"),
        Some(CompassState::Unjudged) => ("unjudged", "?"),
        // An unused compass.
        None => ("unjudged", "–"),
    };
    format!(
        "<p class=\"verdict {class}\"><span aria-hidden=\"true\">{sign}</span> <b>{}.</b> {}.</p>\n",
        capitalised(line.state_word),
        escape_html(&capitalised(line.verdict_text.trim_end_matches('.')))
    )
}

/// Comparison of calibrators and compasses.
fn comparison_table(report: &Report) -> String {
    let names: Vec<&str> = report.calibrators.compasses.iter().map(String::as_str).collect();
    let rows = report.calibrators.calibrator_rows.iter().map(|(name, cells)| {
        let cells = cells.iter().map(|cell| format_optional(*cell, 2)).collect();
        (name.clone(), cells)
    });
    let caption = format!(
        "{} of headings against {}, degrees RMS about the mean",
        capitalised(report.reference.difference_name),
        report.reference.reference_name
    );
    html_table(&caption, "corrected by", &names, rows)
}

/// A chart of `assets/charts.js`: its kind, title and description.
type Chart = (&'static str, &'static str, String);

fn charts(compass_report: &CompassReport, difference_name: &str) -> Vec<Chart> {
    let has_sample = |of: fn(&ReportSample) -> bool| compass_report.samples.iter().any(of);
    let corrected_by = compass_report.corrected_by;
    let marks = concat_map(&compass_report.event_marks, |mark| {
        format!(" {} s: {}.", format_number(mark.time_s, 0), mark.event_name)
    });
    let advice =
        compass_report.advice.as_ref().map_or_else(String::new, |advice| format!(" Most useful next: {advice}."));
    let unused = if has_sample(|sample| !sample.is_usable) { " Grey: not used." } else { "" };
    let chart = |is_drawn: bool, kind, title, description| is_drawn.then_some((kind, title, description));
    [
        chart(
            has_sample(|sample| sample.raw_ut.is_some()),
            "strength",
            "Field strength and current",
            format!("Corrected {corrected_by} it should be constant: a step is iron that changed.{marks}{unused}"),
        ),
        chart(
            has_sample(|sample| sample.error_deg.is_some() || sample.error_before_deg.is_some()),
            "errors",
            "Error over time",
            format!("Drag to choose a part.{}", withheld_headings_note(compass_report)),
        ),
        chart(
            !compass_report.curves_before.is_empty(),
            "by_heading",
            "Error by heading",
            format!("Each {difference_name} and the means."),
        ),
        chart(
            has_sample(|sample| sample.corrected_ut.is_some()),
            "axes",
            "Three axes",
            format!("Corrected {corrected_by}; dashed: the Earth's field."),
        ),
        chart(
            has_sample(|sample| sample.current_a.is_some_and(|a| a > 0.0) && sample.corrected_ut.is_some()),
            "current",
            "Field against current",
            "A slope is interference by the motors.".to_owned(),
        ),
        chart(
            has_sample(|sample| sample.raw_ut.is_some()),
            "sphere",
            "Directions of the field",
            format!(
                "Shaded: directions near level flight that were not flown. Drag it, or use the arrow keys.{advice}"
            ),
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn withheld_headings_note(compass_report: &CompassReport) -> String {
    let withheld_count = compass_report.samples.iter().filter(|sample| sample.is_heading_withheld).count();
    if withheld_count == 0 {
        return String::new();
    }
    let percent = 100.0 * withheld_count as f64 / compass_report.samples.len().max(1) as f64;
    let percent = format_number(percent, if percent < 1.0 { 2 } else { 1 });
    format!(" Shaded: without a heading of the module, {percent} %.")
}

/// Deviation card, as used with ships' compasses.
fn deviation_card(compass_report: &CompassReport, compared: &ReferenceInfo) -> String {
    let Some(first) = compass_report.curves_before.first().or(compass_report.curves_after.first()) else {
        return String::new();
    };
    let sectors = first.errors_deg.len();
    let step = 360 / sectors.max(1);
    let has_sigma = compass_report.sigma_by_heading_deg.len() == sectors;
    let lines = || compass_report.curves_before.iter().chain(&compass_report.curves_after);
    let is_repeated = |line: &DeviationCurve| lines().filter(|other| other.curve_name == line.curve_name).count() > 1;
    let column = |when: &str, line: &DeviationCurve| {
        if is_repeated(line) { format!("{when}: {}", line.curve_name) } else { line.curve_name.clone() }
    };
    let mut columns: Vec<String> = compass_report.curves_before.iter().map(|line| column("before", line)).collect();
    columns.extend(compass_report.curves_after.iter().map(|line| column("after", line)));
    if has_sigma {
        columns.push("sigma".to_owned());
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let row = |i: usize| {
        let mut cells: Vec<String> = lines().map(|line| format_optional(line.card_error_deg(i), 2)).collect();
        if has_sigma {
            let sigma = format_optional(compass_report.sigma_by_heading_deg.get(i).copied(), 2);
            cells.push(if sigma == "–" { sigma } else { format!("± {sigma}") });
        }
        (format!("{:03}", i * step), cells)
    };
    // Two tables, of the first 12 headings and of the others, side by side if there is room.
    let card_halves = [0..sectors.min(12), 12..sectors]
        .into_iter()
        .filter(|sector_range| !sector_range.is_empty())
        .map(|sector_range| {
            let caption = format!("Headings {:03} to {:03}", sector_range.start * step, (sector_range.end - 1) * step);
            html_table(&caption, "heading", &columns, sector_range.map(row))
        });
    let since = compass_report.last_change_s.map_or_else(String::new, |at_s| {
        format!(" Of the flight after {} s, the last change.", format_number(at_s, 0))
    });
    format!(
        "<div class=\"card\">\n<p>{}: degrees by heading, indicated less {}; subtract it from the indicated heading. \
         {}{since}</p>\n<div class=\"halves\">{}</div></div>\n",
        escape_html(&compass_report.compass_name),
        escape_html(&compared.reference_name),
        escape_html(&compared.card_constant_text),
        concat_map(card_halves, |sector_range| sector_range)
    )
}

fn figure(picture: &DeviationPicture) -> String {
    format!(
        "<figure class=\"narrow\"><div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{}: picture\">\n{}\
         </div><figcaption>{}</figcaption></figure>\n",
        picture.title,
        picture.inline(),
        escape_html(&picture.description),
    )
}

/// A table in a scrolling box.
fn html_table(
    caption: &str,
    corner: &str,
    columns: &[&str],
    rows: impl Iterator<Item = (String, Vec<String>)>,
) -> String {
    let caption = escape_html(caption);
    let corner = if corner.is_empty() {
        "<td></td>".to_owned()
    } else {
        format!("<th scope=\"col\">{}</th>", escape_html(corner))
    };
    let header_cells = concat_map(columns, |name| format!("<th scope=\"col\">{}</th>", escape_html(name)));
    let body_rows = concat_map(rows, |(name, cells)| {
        let cells = concat_map(&cells, |cell| format!("<td>{}</td>", escape_html(cell)));
        format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", escape_html(&name))
    });
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{caption}\"><table><caption>{caption}</caption>\n\
         <thead><tr>{corner}{header_cells}</tr></thead>\n<tbody>\n{body_rows}</tbody></table></div>\n"
    )
}

/// Text as part of a URI (RFC 3986).
fn percent_encoded(text: &str) -> String {
    concat_map(text.bytes(), |byte| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    })
}

fn html_listing(id: &str, name: &str, text: &str) -> String {
    let (name, text) = (escape_html(name), escape_html(text));
    format!(
        "<pre id=\"{id}\" class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{name}: text\">{text}</pre>\n"
    )
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + letters.as_str())
}
