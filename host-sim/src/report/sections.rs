//! The parts of the page.

use super::model::{Compared, Line, Report, Swung};
use super::pictures::{Picture, coverage, field, map as map_of, methods as side_by_side, swing, time};
use super::text::{each, escaped, number, number_or_dash};

/// First of all: whether, how well, and what is doubtful.
pub fn verdict(report: &Report) -> String {
    let (class, sign, word) = if report.accepted { ("good", "✓", "Accepted") } else { ("bad", "✗", "Refused") };
    let mut html = vec![format!(
        "<p class=\"verdict {class}\"><span aria-hidden=\"true\">{sign}</span> <b>{word}.</b> {}.</p>\n",
        escaped(&capital(report.verdict.trim_end_matches('.')))
    )];
    if !report.figures.is_empty() {
        let rows = each(&report.figures, |[what, value]| {
            format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escaped(what), escaped(value))
        });
        html.push(format!("<dl class=\"figures\">\n{rows}</dl>\n"));
    }
    if !report.compared.with.is_empty() {
        html.push(format!(
            "<p>Headings are compared with {}: {}. A difference is called {} here.</p>\n",
            escaped(&report.compared.with),
            escaped(&report.compared.limits),
            escaped(report.compared.word)
        ));
    }
    if !report.notes.is_empty() {
        let notes = each(&report.notes, |note| format!("<li>{}</li>\n", escaped(note)));
        html.push(format!("<h3>What is doubtful</h3>\n<ul>\n{notes}</ul>\n"));
    }
    html.concat()
}

/// Calibrators and compasses: a picture and the numbers.
pub fn methods(report: &Report) -> String {
    let names: Vec<&str> = report.methods.compasses.iter().map(String::as_str).collect();
    let rows = report.methods.rows.iter().map(|(name, cells)| {
        let cells = cells.iter().map(|cell| number_or_dash(*cell, 2)).collect();
        (name.clone(), cells)
    });
    let caption = format!(
        "{} of headings against {}, degrees RMS less mean",
        capital(report.compared.word),
        report.compared.with
    );
    let table = table(&caption, "corrected by", &names, rows);
    let picture = side_by_side::methods(&report.methods, &report.compared);
    format!("{}{table}", picture.map_or_else(String::new, |picture| figure("methods", &picture)))
}

/// One compass.
pub fn compass(id: &str, swung: &Swung, compared: &Compared) -> String {
    let facts = each(&swung.facts, |[what, value]| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escaped(what), escaped(value))
    });
    let mut html = vec![format!("<dl class=\"facts\">\n{facts}</dl>\n<div class=\"pair\">\n")];
    if !swung.before.is_empty() {
        html.push(figure(&format!("{id}-scale"), &swing::one_scale(swung, compared.word)));
    }
    if let Some(picture) = swing::enlarged(swung, compared.word) {
        html.push(figure(&format!("{id}-after"), &picture));
    }
    html.push("</div>\n".to_owned());
    html.push(card(swung, compared));
    html.push(figure(&format!("{id}-coverage"), &coverage::coverage(swung)));
    let rest = [("time", time::over_time(swung, compared.word)), ("field", field::field(swung))];
    for (name, picture) in rest.into_iter().filter_map(|(name, picture)| Some((name, picture?))) {
        html.push(figure(&format!("{id}-{name}"), &picture));
    }
    if let Some([x, y, z, b]) = swung.coefficients {
        let row = |name: &str, of: [f64; 3], decimals| {
            (name.to_owned(), of.iter().map(|number_of| number(*number_of, decimals)).collect())
        };
        let rows = [row("W, x", x, 5), row("W, y", y, 5), row("W, z", z, 5), row("b, uT", b, 3)];
        html.push(table(
            "Coefficients: corrected field = W (m - b), body axes",
            "",
            &["x", "y", "z"],
            rows.into_iter(),
        ));
    }
    html.concat()
}

/// The deviation card, as it hangs beside a ship's compass.
fn card(swung: &Swung, compared: &Compared) -> String {
    let Some(first) = swung.before.first().or(swung.after.first()) else { return String::new() };
    let sectors = first.errors_deg.len();
    let step = 360 / sectors.max(1);
    let has_sigma = swung.sigma_deg.len() == sectors;
    let column = |when: &str, line: &Line| format!("{when}: {}", line.name);
    let mut columns: Vec<String> = swung.before.iter().map(|line| column("before", line)).collect();
    columns.extend(swung.after.iter().map(|line| column("after", line)));
    if has_sigma {
        columns.push("sigma".to_owned());
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let row = |i: usize| {
        let lines = swung.before.iter().chain(&swung.after);
        let mut cells: Vec<String> =
            lines.map(|line| number_or_dash(line.errors_deg.get(i).copied().flatten(), 2)).collect();
        if has_sigma {
            let sigma = number_or_dash(swung.sigma_deg.get(i).copied(), 2);
            cells.push(if sigma == "–" { sigma } else { format!("± {sigma}") });
        }
        (format!("{:03}", i * step), cells)
    };
    // Halves of it stand side by side where there is room.
    let halves = [0..sectors.min(12), 12..sectors].into_iter().filter(|half| !half.is_empty()).map(|half| {
        let caption = format!("Headings {:03} to {:03}", half.start * step, (half.end - 1) * step);
        table(&caption, "heading", &columns, half.map(row))
    });
    format!(
        "<div class=\"card\">\n<h3>Deviation card: {}</h3>\n<p>{} by heading, degrees: indicated less {}. Take it off what the \
         compass shows.</p>\n<div class=\"halves\">{}</div></div>\n",
        escaped(&swung.name),
        capital(compared.word),
        escaped(&compared.with),
        each(halves, |half| half)
    )
}

/// The map.
pub fn map(swung: &Swung) -> Option<String> {
    map_of::map(swung).map(|picture| figure("map-picture", &picture))
}

/// Parameters, to be copied.
pub fn parameters(name: &str, text: &str) -> String {
    let name = escaped(name);
    format!(
        "<p>Save it as <code>{name}</code> and load it with a ground station; look at the heading on the ground before you \
         fly by it.</p>\n<p><button type=\"button\" data-copy=\"parameters-text\" hidden>Copy the parameters</button> \
         <span role=\"status\" id=\"copied\"></span></p>\n{}",
        listing("parameters-text", "Parameters", text)
    )
}

/// Command, version, log, settings, and what a terminal showed.
pub fn made(report: &Report) -> String {
    let rows = each(&report.made, |[what, value]| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escaped(what), escaped(value))
    });
    let mut html = vec![format!("<dl class=\"facts\">\n{rows}</dl>\n")];
    if let Some([title, text]) = &report.printed {
        html.push(format!(
            "<details><summary>{}</summary>\n{}</details>\n",
            escaped(title),
            listing("printed-text", title, text)
        ));
    }
    html.concat()
}

fn figure(id: &str, picture: &Picture) -> String {
    let class = if picture.is_wide { "wide" } else { "narrow" };
    format!(
        "<figure class=\"{class}\"><div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{title}: picture\">\n{}\
         </div><figcaption><b>{title}.</b> {}</figcaption></figure>\n",
        picture.svg.inline(id, &picture.title, &picture.words),
        escaped(&picture.words),
        title = escaped(&picture.title),
    )
}

/// A table that scrolls inside its box.
fn table(caption: &str, corner: &str, columns: &[&str], rows: impl Iterator<Item = (String, Vec<String>)>) -> String {
    let caption = escaped(caption);
    let corner =
        if corner.is_empty() { "<td></td>".to_owned() } else { format!("<th scope=\"col\">{}</th>", escaped(corner)) };
    let head = each(columns, |name| format!("<th scope=\"col\">{}</th>", escaped(name)));
    let body = each(rows, |(name, cells)| {
        let cells = each(&cells, |cell| format!("<td>{}</td>", escaped(cell)));
        format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", escaped(&name))
    });
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{caption}\"><table><caption>{caption}</caption>\n\
         <thead><tr>{corner}{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n"
    )
}

fn listing(id: &str, name: &str, text: &str) -> String {
    let (name, text) = (escaped(name), escaped(text));
    format!(
        "<pre id=\"{id}\" class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{name}: text\">{text}</pre>\n"
    )
}

/// With a capital letter first, as a sentence begins.
fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + letters.as_str())
}
