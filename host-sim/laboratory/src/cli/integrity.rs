//! `lab bench integrity`.

use std::process::ExitCode;

use crate::studies::integrity::{
    self, ALL_CASES, AttitudeProtocol, BEGINS_S, DURATIONS_S, FaultCase, IntegrityPlan, IntegrityRow, SWEEP_FAMILIES,
    Sweep, fault_case,
};
use autoswing::attitude::AttitudeSource;
use autoswing_module::settings::HeadingKind;
use clap::Args;
use comfy_table::Table;
use simulator::world::aircraft::VehicleKind;

use host_sim::command_failure::CommandFailure;
use host_sim::option_parsers::{integer_in_range, named_value, one_of};
use host_sim::print::{self, narrow_table, progress_bar, right_aligned, table_of, wrapped_table};
use log_analysis::numbers::format_optional;

const HEADING_KINDS: &[(&str, HeadingKind)] = &[("raw", HeadingKind::Raw), ("smooth", HeadingKind::Smooth)];

/// Faults in flight and during calibration: fraction of wrong headings among those sent as good.
///
/// Random airframes at random places calibrate and fly on for three minutes with the firmware's own tasks, with a fault
/// of the sensor, the attitude source, the airframe's iron or the place. A heading is bad if its error exceeds four of
/// the sigmas sent with it and 5 deg. A calibration is wrong if its true error is more than three times the expected
/// one. An alarm is a period without headings that begins without a fault. 100 flights of every case take about five
/// minutes on two cores.
#[derive(Debug, Args)]
#[command(after_help = "Example: lab bench integrity --case moved-5 --flights 3")]
pub struct IntegrityOptions {
    /// Kind of aircraft; a copter or a VTOL calibrates by its routine, and turns and accelerates in hover
    #[arg(long, default_value = "plane", value_name = "plane|copter|vtol", value_parser = one_of::<VehicleKind>("plane|copter|vtol"))]
    aircraft: VehicleKind,
    /// Flights of each case, 1 to 100000; the ten-hour case is flown once
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = integer_in_range(1_u64, 100_000))]
    flights: u64,
    /// Seed of the first flight, incremented for the others, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer_in_range(0, u64::MAX))]
    seed: u64,
    /// Run only this case; may be repeated; `list` shows the cases. A case `sweep-...` is a family of changes, flown
    /// with N flights of each duration and begin, after the calibration and after a power-on
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<String>,
    /// Autopilot: MAVLink; ArduPilot by MSP, polled, in steps of 0.1 deg without body rates; or INAV by MSP, with
    /// body rates in steps of 1 deg/s
    #[arg(long, default_value = "mavlink", value_name = "mavlink|msp|msp-inav", value_parser = one_of::<AttitudeProtocol>("mavlink|msp|msp-inav"))]
    source: AttitudeProtocol,
    /// Attitude: the autopilot's, the module's own, or the autopilot's, checked by the own gyro (auto)
    #[arg(long, default_value = "autopilot", value_name = "autopilot|own|auto", value_parser = named_value(&AttitudeSource::NAMED_SOURCES))]
    attitude: AttitudeSource,
    /// Heading that is sent: raw, or smoothed if available
    #[arg(long, default_value = "smooth", value_name = "raw|smooth", value_parser = named_value(HEADING_KINDS))]
    heading: HeadingKind,
    /// Print a JSON list of one object a case instead of the table
    #[arg(long)]
    json: bool,
}

pub fn run_integrity(options: &IntegrityOptions) -> Result<ExitCode, CommandFailure> {
    let IntegrityOptions { heading, aircraft, source, attitude, flights, seed, .. } = *options;
    let applies = |case: &FaultCase| case.applies_to_vehicle(aircraft) && case.applies_to_protocol(source);
    if options.cases.iter().any(|name| name == "list") {
        print_cases(&applies);
        return Ok(ExitCode::SUCCESS);
    }
    let plan =
        IntegrityPlan { flights_per_case: flights, seed, heading, aircraft, attitude_protocol: source, attitude };
    let (families, names): (Vec<_>, Vec<_>) =
        options.cases.iter().cloned().partition(|name| fault_case::find_family(name).is_some());
    for family in families.iter().filter_map(|name| fault_case::find_family(name)).filter(|family| applies(family)) {
        fly_sweep(plan, family, options.json)?;
    }
    if names.is_empty() && !families.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    let cases = selected_cases(&names, &applies, aircraft)?;
    let bar = progress_bar("flights", integrity::flight_count(plan, &cases));
    let rows = integrity::run_integrity_study(plan, &cases, &|| bar.inc(1));
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

fn fly_sweep(plan: IntegrityPlan, family: &FaultCase, is_json: bool) -> Result<(), CommandFailure> {
    let changes = integrity::all_changes();
    let bar = progress_bar("flights", changes.len() as u64 * plan.flights_per_case);
    let sweep = integrity::run_sweep(plan, family, &changes, &|| bar.inc(1));
    bar.finish_and_clear();
    if is_json {
        return print::print_json(&sweep);
    }
    let [_, headings] = format_tables(std::slice::from_ref(&sweep.total));
    print::print_line(format_args!("{headings}"));
    for (follows_power_on, start) in [(false, "calibration"), (true, "power-on and 30 s of rest")] {
        print::print_line(format_args!("After {start}: bad %, worst deg, worst deg for 10 s at 2 deg or less"));
        print::print_line(format_map(&sweep, follows_power_on));
    }
    Ok(())
}

/// A row a duration, a column a begin.
fn format_map(sweep: &Sweep, follows_power_on: bool) -> Table {
    let begins = BEGINS_S.map(|begin_s| format!("from {begin_s} s"));
    let mut map = narrow_table(std::iter::once("within, s").chain(begins.iter().map(String::as_str)));
    for duration_s in DURATIONS_S {
        let of_row = sweep
            .cells
            .iter()
            .filter(|cell| cell.follows_power_on == follows_power_on && cell.duration_s.total_cmp(&duration_s).is_eq());
        let cells =
            of_row.map(|cell| format!("{:.1} {:.0} {:.0}", cell.bad_percent, cell.worst_deg, cell.worst_10s_deg));
        map.add_row(std::iter::once(format!("{duration_s}")).chain(cells).map(right_aligned));
    }
    map
}

fn selected_cases(
    names: &[String],
    applies: &dyn Fn(&FaultCase) -> bool,
    aircraft: VehicleKind,
) -> Result<Vec<&'static FaultCase>, CommandFailure> {
    if names.is_empty() {
        return Ok(ALL_CASES.iter().filter(|case| applies(case)).collect());
    }
    let find = |name: &String| {
        let case = fault_case::find_by_name(name).filter(|case| applies(case));
        case.ok_or_else(|| {
            CommandFailure(format!(
                "no case {name} for a {} with this source; --case list shows all",
                aircraft.vehicle_name()
            ))
        })
    };
    names.iter().map(find).collect()
}

fn print_cases(applies: &dyn Fn(&FaultCase) -> bool) {
    let mut table = wrapped_table(["case", "fault"]);
    for case in ALL_CASES.iter().chain(SWEEP_FAMILIES).filter(|case| applies(case)) {
        table.add_row([case.case_name, case.description]);
    }
    print::print_line(table);
}

/// Formats a table of calibrations and one of headings, since one would be too wide for a terminal.
fn format_tables(rows: &[IntegrityRow]) -> [Table; 2] {
    let calibrations = table_of(
        rows,
        &[
            ("case", |row| row.case.to_owned()),
            ("flights", |row| row.flights.to_string()),
            ("accepted,\n%", |row| format!("{:.0}", row.accepted_percent)),
            ("wrong,\n%", |row| format!("{:.0}", row.wrong_percent)),
            ("true/\nexpected", |row| {
                let [median, largest] = [row.error_ratio_median, row.error_ratio_largest];
                format!("{}, {}", format_optional(median, 1), format_optional(largest, 1))
            }),
            ("iron,\n%", |row| format_optional(row.hard_iron_error_median_percent, 0)),
            ("alarms\nper h", |row| format!("{:.1}", row.alarms_per_hour)),
        ],
    );
    let headings = table_of(
        rows,
        &[
            ("case", |row| row.case.to_owned()),
            ("bad,\n%", |row| format!("{:.2}", row.bad_percent)),
            ("long-\nest, s", |row| format!("{:.1}", row.longest_bad_s)),
            ("worst", |row| format!("{:.1}", row.worst_deg)),
            ("smooth\n%", |row| format!("{:.0}", row.smooth_percent)),
            ("rms", |row| format!("{:.2}", row.rms_deg)),
            ("1/2/3\nsigma, %", |row| {
                let [one, two] = [row.within_one_sigma_percent, row.within_two_sigma_percent];
                format!("{one:.0}/{two:.0}/{:.1}", row.within_three_sigma_percent)
            }),
            ("empty,\n%", |row| format!("{:.2}", row.empty_percent)),
        ],
    );
    [calibrations, headings]
}
