//! `host-sim bench integrity`.

use std::process::ExitCode;

use comfy_table::Table;
use host_sim::studies::integrity::{self, CASES, Case, IntegrityPlan, IntegrityRow, case};
use simulator::world::aircraft::VehicleKind;

use super::failure::Failure;
use super::print::{self, narrow_table, right_aligned, wrapped_table};
use super::{Integrity, progress};

pub fn run(options: &Integrity) -> Result<ExitCode, Failure> {
    let Integrity { heading, aircraft, source, flights, seed, .. } = *options;
    let applies = |case: &Case| case.applies_to_vehicle(aircraft) && case.applies_to_protocol(source);
    if options.cases.iter().any(|name| name == "list") {
        print_cases(&applies);
        return Ok(ExitCode::SUCCESS);
    }
    let cases = selected_cases(&options.cases, &applies, aircraft)?;
    let plan = IntegrityPlan { flights, seed, heading, aircraft, source };
    let bar = progress("flights", integrity::flights(plan, &cases));
    let rows = integrity::run(plan, &cases, &|| bar.inc(1));
    bar.finish_and_clear();
    if options.json {
        print::print_json(&rows)?;
    } else {
        let [calibrations, headings] = format_tables(&rows);
        print::print_line(format_args!("{calibrations}\n{headings}"));
        print::print_line("true/expected: errors of accepted calibrations, median and worst");
        print::print_line("iron: error of the reported hard-iron change, as a part of its size, median");
        print::print_line("bad, worst, rms: headings that are sent as good, degrees");
    }
    Ok(ExitCode::SUCCESS)
}

fn selected_cases(
    names: &[String],
    applies: &dyn Fn(&Case) -> bool,
    aircraft: VehicleKind,
) -> Result<Vec<&'static Case>, Failure> {
    if names.is_empty() {
        return Ok(CASES.iter().filter(|case| applies(case)).collect());
    }
    let find = |name: &String| {
        let case = case::find_by_name(name).filter(|case| applies(case));
        case.ok_or_else(|| {
            Failure(format!("no case {name} for a {} with this source; --case list shows all", aircraft.name()))
        })
    };
    names.iter().map(find).collect()
}

fn print_cases(applies: &dyn Fn(&Case) -> bool) {
    let mut table = wrapped_table(["case", "fault"]);
    for case in CASES.iter().filter(|case| applies(case)) {
        table.add_row([case.name, case.description]);
    }
    print::print_line(table);
}

/// Formats a table of calibrations and one of headings, since one would be too wide for a terminal.
fn format_tables(rows: &[IntegrityRow]) -> [Table; 2] {
    let mut calibrations =
        narrow_table(["case", "flights", "accepted,\n%", "wrong,\n%", "true/\nexpected", "iron,\n%", "alarms\nper h"]);
    let mut headings =
        narrow_table(["case", "bad,\n%", "long-\nest, s", "worst", "smooth\n%", "rms", "1/2/3\nsigma, %", "empty,\n%"]);
    for row in rows {
        let ratio = |ratio: Option<f64>| ratio.map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.1}"));
        calibrations.add_row(
            [
                row.case.to_owned(),
                row.flights.to_string(),
                format!("{:.0}", row.accepted_percent),
                format!("{:.0}", row.wrong_percent),
                format!("{}, {}", ratio(row.ratio_median), ratio(row.ratio_worst)),
                row.iron_error_median_percent.map_or_else(|| "-".to_owned(), |percent| format!("{percent:.0}")),
                format!("{:.1}", row.alarms_per_hour),
            ]
            .map(right_aligned),
        );
        headings.add_row(
            [
                row.case.to_owned(),
                format!("{:.2}", row.bad_percent),
                format!("{:.1}", row.longest_bad_s),
                format!("{:.1}", row.worst_deg),
                format!("{:.0}", row.smooth_percent),
                format!("{:.2}", row.rms_deg),
                format!(
                    "{:.0}/{:.0}/{:.1}",
                    row.within_one_sigma_percent, row.within_two_sigma_percent, row.within_three_sigma_percent
                ),
                format!("{:.2}", row.empty_percent),
            ]
            .map(right_aligned),
        );
    }
    [calibrations, headings]
}
