//! `host-sim table1`.

use std::process::ExitCode;

use comfy_table::Table;
use host_sim::paper::{self, Column, Experiment};
use host_sim::score::Figures;
use host_sim::world::table1::{self, Row, Sides};
use serde_json::{Value, json};

use super::print::{self, narrow_table, right_aligned};
use super::{Failure, Table1};

pub fn run(options: &Table1) -> Result<ExitCode, Failure> {
    let columns = |experiment| paper::columns(experiment).map_err(|error| Failure(error.to_string()));
    let noise_free = columns(Experiment::NOISE_FREE)?;
    let noisy = columns(Experiment::noisy(options.seed))?;
    let published = published();
    if options.json {
        let value = json!({
            "noise_free": figures(&noise_free),
            "noisy": figures(&noisy),
            "published": figures(&published),
            "errors": { "noise_free": noise_free, "noisy": noisy },
            "seed": options.seed,
        });
        print::json(value)?;
    } else {
        print::line("Liu 2007 table 1: heading error in degrees, indicated less true, at 20 deg of");
        print::line(format_args!("tilt right / left\n{}", errors(&noise_free)));
        print::line("published; 12 samples a side without noise; 256 a side with a LIS3MDL's noise:");
        print::line("largest error, constant error, largest less the constant; deg");
        print::line(summary(&published, &noise_free, &noisy));
    }
    Ok(ExitCode::SUCCESS)
}

/// What the paper printed.
fn published() -> [Column; 3] {
    let rows = table1::published();
    let column = |name, of: fn(&Row) -> Sides| Column {
        name,
        right_deg: rows.map(|row| of(&row).right_deg),
        left_deg: rows.map(|row| of(&row).left_deg),
    };
    [
        column("before", |row| row.before),
        column("reference", |row| row.reference),
        column("four ellipses", |row| row.four_ellipse),
    ]
}

fn figures(columns: &[Column]) -> Value {
    columns.iter().map(|column| (column.name.replace(' ', "_"), json!(column.figures()))).collect()
}

fn errors(columns: &[Column]) -> Table {
    let names = columns.iter().map(|column| column.name.replace(' ', "\n"));
    let mut table = narrow_table(std::iter::once("heading".to_owned()).chain(names));
    for row in 0..paper::HEADINGS {
        let cells = columns.iter().map(|column| {
            let Sides { right_deg, left_deg } = column.sides(row);
            format!("{} / {}", plain(right_deg), plain(left_deg))
        });
        table.add_row(std::iter::once((row * 30).to_string()).chain(cells).map(right_aligned));
    }
    table
}

fn summary(published: &[Column], noise_free: &[Column], noisy: &[Column]) -> Table {
    let mut table = narrow_table(["", "published", "12 a side", "256 a side"]);
    for (exact, noisy) in noise_free.iter().zip(noisy) {
        let printed = published.iter().find(|column| column.name == exact.name);
        let cells = [printed, Some(exact), Some(noisy)].map(|column| column.map_or_else(String::new, three));
        table.add_row(std::iter::once(exact.name.replace("maximum", "max.")).chain(cells).map(right_aligned));
    }
    table
}

fn three(column: &Column) -> String {
    let Figures { max_deg, mean_deg, max_demeaned_deg, .. } = column.figures();
    format!("{}  {}  {}", plain(max_deg), plain(mean_deg), plain(max_demeaned_deg))
}

/// Two decimals, and no minus before what rounds to nothing.
fn plain(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text }
}
