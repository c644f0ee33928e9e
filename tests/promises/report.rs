//! Contents and safety of the report's page.

use log_analysis::log::log_writers::{FlightRecording, encode_dataflash};
use log_analysis::log::{self, csv::FieldUnit};
use log_analysis::numbers::format_number;
use log_analysis::replay::RowSelection;
use log_analysis::replay::evaluation::{EvaluationOptions, evaluate_flight};
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::{CompassState, Verdict};
use log_analysis::replay::{ParameterChange, ParameterFile};
use log_analysis::report::model::{
    CalibratorComparison, CompassReport, DeviationCurve, EventMark, ReferenceInfo, Report, ReportSample, VerdictLine,
};
use log_analysis::report::{ReportOrigin, render_page, render_picture, report_replay};
use log_analysis::score::wrap_180;
use serde_json::Value;
use simulator::mission::{MissionResult, TurnPlan, fly_mission};
use simulator::mission_report::report_mission;
use simulator::recording::record_turns;
use simulator::world::WorldConfig;

fn fly_plan(plan: TurnPlan) -> MissionResult {
    fly_mission(WorldConfig::of_table1(1), plan, &mut |_| {})
}

fn report_page(mission: &MissionResult) -> String {
    render_page(&report_mission(
        mission,
        &ReportOrigin { command_line: "host-sim fly".to_owned(), ..ReportOrigin::default() },
    ))
}

/// Texts between a marker and the next end marker.
fn texts_after<'a>(html: &'a str, marker: &'a str, end: &'a str) -> impl Iterator<Item = &'a str> {
    html.split(marker).skip(1).filter_map(move |after_marker| after_marker.split(end).next())
}

fn assert_contains_all(html: &str, texts: &[&str]) {
    for text in texts {
        assert!(html.contains(text), "{text}");
    }
}

fn assert_well_formed(html: &str) {
    const VOID_ELEMENTS: [&str; 2] = ["meta", "!doctype"];
    let mut open: Vec<&str> = Vec::new();
    let mut remaining = html;
    while let Some((_, from_tag)) = remaining.split_once('<') {
        let (tag, after_tag) = from_tag.split_once('>').expect("a tag ends");
        remaining = after_tag;
        let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next().expect("a name");
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "{tag}");
        } else if !tag.ends_with('/') && !VOID_ELEMENTS.contains(&name) {
            open.push(name);
            if ["style", "script"].contains(&name) {
                remaining = &remaining[remaining.find("</").expect("an end")..];
            }
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

fn assert_safe_page(html: &str) {
    assert_well_formed(html);
    assert!(html.ends_with("</html>\n"));
    let (contents, script) = html.split_once("<script>").expect("the page's own script");
    for never in ["NaN", "inf ", "http:", "https:", "url(", "@import", "\u{1b}", "src=", "<link", "<img", "style=\""] {
        assert!(!contents.contains(never), "{never}");
    }
    // The script names the origin of uPlot; the page's policy allows no request.
    assert_eq!(script.matches("https:").count() + script.matches("http:").count(), 1);
    assert!(contents.contains("default-src 'none'"));
    let pictures = contents.matches("<svg ").count();
    let charts = contents.matches("class=\"chart\"").count();
    assert_eq!(contents.matches("role=\"img\"").count(), pictures + charts);
    assert_eq!(contents.matches("<title id=").count(), pictures);
    assert_eq!(contents.matches("<script").count(), contents.matches("<script type=\"application/json\">").count());
    // Scrolling boxes are reachable by keyboard and have a name.
    assert_eq!(html.matches("class=\"scroll\"").count(), html.matches("tabindex=\"0\" role=\"group\"").count());
    let ids: Vec<&str> = texts_after(html, " id=\"", "\"").collect();
    let mut unique = ids.clone();
    unique.sort_unstable();
    unique.dedup();
    assert_eq!(unique.len(), ids.len(), "{ids:?}");
    for target in texts_after(html, "href=\"#", "\"") {
        assert!(ids.contains(&target), "{target}");
    }
}

#[test]
fn a_calibrated_mission_is_reported_the_same_each_time() {
    let flown = fly_plan(TurnPlan::default());
    let html = report_page(&flown);
    assert_eq!(html, report_page(&flown));
    assert_safe_page(&html);
    let charts = ["Field strength and current", "Error over time", "Error by heading", "Directions of the field"];
    assert_contains_all(&html, &charts);
    assert_contains_all(&html, &["Verdict", "Three axes.", "Deviation card"]);
    assert_contains_all(&html, &["About this flight", "Console session"]);
    let (before, after) = (flown.errors_before.statistics(), flown.errors_after.statistics());
    let expected_deg = flown.calibration_result.as_ref().unwrap().expected_rms_deg;
    for figure in
        [before.max_deg, after.max_deg, after.rms_deg, expected_deg, flown.streamed_statistics.unwrap().rms_deg]
    {
        assert!(html.contains(&format!("<dd>{figure:.2} deg</dd>")), "{figure:.2}");
    }
    for (step, heading) in (0..12).map(|step| (step, format!("<th scope=\"row\">{:03}</th>", 30 * step))) {
        assert!(html.contains(&heading), "{heading}");
        for bank in flown.errors_before.0.iter().chain(&flown.errors_after.0) {
            assert!(html.contains(&format!("<td>{}</td>", format_number(bank[step], 2))), "{heading}");
        }
    }
    assert!(html.contains(">host-sim fly</dd>") && html.contains(env!("CARGO_PKG_VERSION")));
    assert!(html.len() < 300_000, "{}", html.len());
}

#[test]
fn a_refusal_is_reported_with_its_reason_and_no_after_picture() {
    let html = report_page(&fly_plan(TurnPlan { bank_deg: 25.0, circles_per_side: 0.05 }));
    assert_safe_page(&html);
    assert!(html.contains("too-few-samples") && html.contains("Refused"));
    assert!(!html.contains("Three axes.") && !html.contains("<th scope=\"col\">after"));
}

const WITH_MODULE: EvaluationOptions =
    EvaluationOptions { compared_module: Some(RowSelection::Flight), ..EvaluationOptions::DEFAULT };

#[test]
fn a_replayed_log_has_the_numbers_of_its_json() {
    let mut bytes: &[u8] = include_bytes!("../../host-sim/data/flight.csv");
    let flight = log::read_flight(&mut bytes, FieldUnit::Milligauss).unwrap();
    let verdict = evaluate_flight(&flight, &WITH_MODULE);
    let judgement = Verdict::new(&flight, &verdict, ParameterFormat::ArduPilot);
    let report = report_replay(&judgement, "a folder/flight.csv", &ReportOrigin::default());
    let html = render_page(&report);
    assert_safe_page(&html);
    let json = judgement.json();
    let verdict_line = json["verdict"].as_str().unwrap();
    assert!(!verdict_line.contains(['&', '<', '>', '"', '\'']), "nothing in it is escaped: {verdict_line}");
    assert!(html.to_lowercase().contains(&verdict_line.to_lowercase()), "{verdict_line}");
    let class = format!("class=\"verdict {}\"", json["state"].as_str().unwrap());
    assert!(html.contains(&class), "{class}");
    assert_contains_all(&html, &["corrected by", "Deviation card", "Field strength and current", "Error by heading"]);
    assert_contains_all(&html, &["Directions of the field", "Download compass.param", "Flight flight.csv"]);
    // The answer comes before everything that is folded: verdict, picture, file.
    let [verdict_at, picture_at, file_at, folded_at] =
        ["class=\"verdict", "id=\"deviation-t\"", "download=\"compass.param\"", "<summary><h2"]
            .map(|part| html.find(part).expect(part));
    assert!(verdict_at < picture_at && picture_at < file_at && file_at < folded_at);
    // Table cells have two decimals, JSON three.
    let is_shown = |expected: &Value, before_cell: &str, after_cell: &str| {
        let expected = expected.as_f64().unwrap();
        let mut cells = texts_after(&html, before_cell, after_cell).filter_map(|cell| cell.parse::<f64>().ok());
        assert!(cells.any(|cell| (cell - expected).abs() < 0.0056), "{expected}");
    };
    for compass in json["compasses"].as_array().unwrap() {
        is_shown(&compass["fit"]["expected_rms_deg"], "<dd>", " deg RMS");
        for heading in compass["headings"].as_array().unwrap() {
            is_shown(&heading["against_reference"]["heading_rms_deg"], "<td>", "</td>");
        }
    }
}

/// The first of two compasses is dead.
#[test]
fn a_log_report_shows_the_flown_attitude() {
    let mut world = WorldConfig::of_table1(1);
    // Inclination by the field model at the start position, degrees.
    world.earth.inclination_deg = 64.0;
    let mut recording = FlightRecording { start_position: Some([48.0, 11.3, 500.0]), ..record_turns(&world, 0.0) };
    recording.samples.iter_mut().for_each(|sample| sample.field_ut.insert(0, [10.0, 20.0, 30.0]));
    let flight = log::read_flight(&mut encode_dataflash(&recording).as_slice(), FieldUnit::Milligauss).unwrap();
    let verdict = evaluate_flight(&flight, &WITH_MODULE);
    let judgement = Verdict::new(&flight, &verdict, ParameterFormat::ArduPilot);
    let report = report_replay(&judgement, "flight.bin", &ReportOrigin::default());
    // The compass in use is not known: the first is judged, and one good compass does not make the page green.
    assert_eq!(report.verdicts[0].compass_state, Some(CompassState::Bad), "{:?}", report.verdicts);
    assert!(report.verdicts[0].verdict_text.contains("replace"), "{:?}", report.verdicts);
    let report_samples = &report.compasses[1].samples;
    let usable = || report_samples.iter().filter(|sample| sample.is_usable && !sample.is_heading_withheld);
    assert!(usable().count() > 2000);
    // Bounds for attitude noise of 0.5 deg and field noise of 0.3 uT.
    let [total_ut, inclination_deg] = report.compasses[1].earth_field.unwrap();
    assert!((inclination_deg - 64.0).abs() < 1.0, "{inclination_deg}");
    for report_sample in usable() {
        let [x, y, z] = report_sample.corrected_ut.unwrap();
        assert!((x.hypot(y).hypot(z) / total_ut - 1.0).abs() < 0.05);
        // When the nose points east, north is to the left.
        let [(sin_roll, cos_roll), (sin_pitch, cos_pitch)] =
            [report_sample.roll_deg, report_sample.pitch_deg].map(|angle_deg| angle_deg.to_radians().sin_cos());
        let down_ut = y * sin_roll + z * cos_roll;
        let (forward_ut, left_ut) = (x * cos_pitch + down_ut * sin_pitch, z * sin_roll - y * cos_roll);
        let off_deg = wrap_180(left_ut.atan2(forward_ut).to_degrees() - report_sample.heading_deg.unwrap());
        assert!(off_deg.abs() < 12.0, "{off_deg} at {} s", report_sample.time_s);
    }
}

/// Text of a log is escaped; numbers that are not finite become dashes or are not drawn.
#[test]
fn text_of_a_hostile_log_is_escaped() {
    const HOSTILE_TEXT: &str = "</title><script>alert(1)</script>\"'><img src=x onerror=alert(1)>\u{1b}[2K\u{0}";
    let hostile = || HOSTILE_TEXT.to_owned();
    let nan = Some(f64::NAN);
    let hostile_sample = |i: u32| ReportSample {
        time_s: f64::from(i),
        heading_deg: nan,
        roll_deg: f64::NAN,
        pitch_deg: f64::INFINITY,
        raw_ut: Some([f64::NAN; 3]),
        logged_ut: Some([f64::INFINITY; 3]),
        corrected_ut: if i.is_multiple_of(2) { Some([f64::NAN; 3]) } else { Some([1.0; 3]) },
        current_a: nan,
        error_parameters_deg: nan,
        error_deg: Some(f64::INFINITY),
        sigma_deg: nan,
        error_before_deg: nan,
        is_usable: true,
        is_heading_withheld: true,
    };
    let line = DeviationCurve {
        curve_name: hostile(),
        errors_deg: vec![None, nan, Some(f64::INFINITY), Some(1.0)],
        constant_deg: f64::NAN,
    };
    let compass_report = CompassReport {
        compass_name: hostile(),
        facts: vec![[hostile(), hostile()]],
        curves_before: vec![line.clone()],
        curves_after: vec![line],
        sigma_by_heading_deg: vec![f64::NAN, 0.5, f64::INFINITY, -0.0],
        samples: (0..50).map(hostile_sample).collect(),
        event_marks: [f64::NAN, 1e9].map(|time_s| EventMark { time_s, event_name: hostile() }).into(),
        earth_field: Some([f64::NAN; 2]),
        magnetic_offset_deg: f64::NAN,
        advice: Some(hostile()),
        coefficients: Some([[f64::NAN; 3]; 4]),
        ..CompassReport::default()
    };
    let verdict =
        VerdictLine { compass_state: Some(CompassState::Unjudged), state_word: "Unjudged", verdict_text: hostile() };
    let report = Report {
        correction_choices: hostile(),
        title: hostile(),
        verdicts: vec![verdict],
        key_figures: vec![[hostile(), hostile()]],
        log_warnings: vec![hostile()],
        reference: ReferenceInfo {
            difference_name: "error",
            reference_name: hostile(),
            accuracy_text: hostile(),
            card_constant_text: hostile(),
            is_accurate: true,
        },
        calibrators: CalibratorComparison {
            compasses: vec![hostile()],
            calibrator_rows: vec![(hostile(), vec![nan]), (hostile(), vec![Some(1.0)])],
        },
        compasses: vec![compass_report],
        next_steps: vec![hostile()],
        parameter_files: ["compass.param", "compass.params"]
            .map(|file_name| ParameterFile { file_name, text: hostile() })
            .into(),
        parameter_changes: vec![ParameterChange { name: hostile(), logged_value: nan, new_value: hostile() }],
        console_session: Some(hostile()),
        origin: vec![[hostile(), hostile()]],
    };
    let html = render_page(&report);
    assert!(html.contains("&lt;script&gt;alert(1)") && !html.contains("<img") && !html.contains("<script>alert"));
    assert_safe_page(&html.replace("src=x", ""));
    let svg_text = render_picture(&report);
    assert!(!svg_text.contains("NaN") && !svg_text.contains("inf") && !svg_text.contains("<script"), "{svg_text}");
}

#[test]
fn an_empty_report_gives_a_valid_page() {
    assert_safe_page(&render_page(&Report::default()));
    assert_safe_page(&render_page(&Report { compasses: vec![CompassReport::default()], ..Report::default() }));
    assert!(render_picture(&Report::default()).contains("</svg>"));
}

#[test]
fn a_standalone_picture_has_a_background_and_both_colour_schemes() {
    let svg_text = render_picture(&report_mission(&fly_plan(TurnPlan::default()), &ReportOrigin::default()));
    assert!(svg_text.starts_with("<svg xmlns=") && svg_text.ends_with("</svg>\n"));
    let needed = ["class=\"paper\"", "prefers-color-scheme:dark", "deg before"];
    assert_contains_all(&svg_text, &needed);
    assert!(svg_text.len() < 15_000, "{}", svg_text.len());
}
