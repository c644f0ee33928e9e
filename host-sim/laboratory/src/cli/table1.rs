//! `lab table1`.

use std::process::ExitCode;

use crate::studies::paper_experiment::{self, PaperExperiment};
use clap::Args;
use comfy_table::Table;
use log_analysis::numbers::format_number;
use log_analysis::score::ErrorStatistics;
use serde_json::{Value, json};
use simulator::world::published_table1::{HEADING_COUNT, MethodErrors, published_errors};

use host_sim::command_failure::CommandFailure;
use host_sim::option_parsers::integer_in_range;
use host_sim::print::{self, narrow_table, right_aligned};

/// Compare the methods on the aircraft of Liu 2007 table 1.
///
/// The airframe is fitted to the published errors. As in the paper's experiment it is tilted 20 deg to either side at
/// zero pitch: at 12 headings without noise, and at 256 with the noise of a LIS3MDL.
#[derive(Debug, Args)]
#[command(after_help = "Example: lab table1 --seed 3")]
pub struct Table1Options {
    /// Seed of the sensor's noise, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer_in_range(0, u64::MAX))]
    seed: u64,
    /// Print one JSON object instead of the tables
    #[arg(long)]
    json: bool,
}

pub fn run_table1(options: &Table1Options) -> Result<ExitCode, CommandFailure> {
    let columns =
        |experiment| paper_experiment::method_errors(experiment).map_err(|error| CommandFailure(error.to_string()));
    let noise_free = columns(PaperExperiment::NOISE_FREE)?;
    let noisy = columns(PaperExperiment::noisy_experiment(options.seed))?;
    let published_errors = published_errors();
    if options.json {
        let value = json!({
            "noise_free": json_figures(&noise_free),
            "noisy": json_figures(&noisy),
            "published": json_figures(&published_errors),
            "errors": { "noise_free": noise_free, "noisy": noisy },
            "seed": options.seed,
        });
        print::print_json(value)?;
    } else {
        print::print_line("Liu 2007 table 1: heading error in degrees, indicated less true, at 20 deg of");
        print::print_line(format_args!("tilt right / left\n{}", errors_table(&noise_free)));
        print::print_line("published; 12 samples a side without noise; 256 a side with a LIS3MDL's noise:");
        print::print_line("largest error, constant error, largest less the constant; deg");
        print::print_line(summary_text(&published_errors, &noise_free, &noisy));
    }
    Ok(ExitCode::SUCCESS)
}

fn json_figures(columns: &[MethodErrors]) -> Value {
    columns.iter().map(|column| (column.name.replace(' ', "_"), json!(column.error_statistics()))).collect()
}

fn errors_table(columns: &[MethodErrors]) -> Table {
    let names = columns.iter().map(|column| column.name.replace(' ', "\n"));
    let mut table = narrow_table(std::iter::once("heading".to_owned()).chain(names));
    for row in 0..HEADING_COUNT {
        let cells = columns.iter().map(|column| {
            format!("{} / {}", format_number(column.right_deg[row], 2), format_number(column.left_deg[row], 2))
        });
        table.add_row(std::iter::once((row * 30).to_string()).chain(cells).map(right_aligned));
    }
    table
}

fn summary_text(published_errors: &[MethodErrors], noise_free: &[MethodErrors], noisy: &[MethodErrors]) -> Table {
    let mut table = narrow_table(["", "published", "12 a side", "256 a side"]);
    for (noise_free_column, noisy) in noise_free.iter().zip(noisy) {
        let printed = published_errors.iter().find(|column| column.name == noise_free_column.name);
        let cells = [printed, Some(noise_free_column), Some(noisy)]
            .map(|column| column.map_or_else(String::new, format_errors));
        table.add_row(
            std::iter::once(noise_free_column.name.replace("maximum", "max.")).chain(cells).map(right_aligned),
        );
    }
    table
}

fn format_errors(column: &MethodErrors) -> String {
    let ErrorStatistics { max_deg, mean_deg, max_demeaned_deg, .. } = column.error_statistics();
    format!("{}  {}  {}", format_number(max_deg, 2), format_number(mean_deg, 2), format_number(max_demeaned_deg, 2))
}
