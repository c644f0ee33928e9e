//! Logs written by `fly --record`.

use std::path::Path;

use log_analysis::log::{Gps, log_writers};
use log_analysis::score::wrap_180;
use simulator::module::Module as _;
use simulator::recording::Recorder;
use simulator::rig::Rig;
use simulator::world::WorldConfig;
use simulator::world::autopilot::Leg;

use super::{compare_with_module, module_score};

/// Declination at Xi'an is -4.2 deg (WMM2025), so magnetic headings exceed true ones by 4.2 deg.
#[test]
fn a_recorded_flight_has_its_position_and_true_headings() {
    let mut rig = Rig::new(WorldConfig::of_table1(1));
    let mut recorder = Recorder::new(&rig);
    for heading_change_deg in [1440.0, -1440.0] {
        rig.world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    rig.world.append_leg(Leg::Straight { heading_deg: 90.0, seconds: 60.0 });
    for _ in 0..300 {
        rig.run_for_s(1.0);
        recorder.record_until(rig.now_us(), &rig.world);
    }
    for name in ["flight.bin", "flight.log", "flight.tlog", "flight.ulg", "flight.csv"] {
        let (flight, evaluation) =
            compare_with_module(&log_writers::encode_for_path(Path::new(name), &recorder.recording));
        let score = module_score(&evaluation.compasses[0]);
        assert!((score.mean_deg - 4.2).abs() < 0.5, "{name}: {score:?}");
        let (field, _) = evaluation.earth_field.unwrap();
        assert!((field.declination_deg.unwrap() + 4.2).abs() < 0.1, "{name}: {field:?}");
        let rows = flight.gps.rows();
        let [before, after] =
            [rows.len() - 50, rows.len() - 1].map(|row_index| Gps::from_columns(rows[row_index].row_values));
        let shrinks = f64::from(before.latitude_deg).to_radians().cos();
        let north = f64::from(after.latitude_deg - before.latitude_deg);
        let east = f64::from(after.longitude_deg - before.longitude_deg) * shrinks;
        let off_deg = wrap_180(east.atan2(north).to_degrees() - f64::from(after.course_deg));
        // Single-precision longitude resolves 1 m, of a leg of 100 m.
        assert!(off_deg.abs() < 3.0, "{name}: {off_deg}");
    }
    assert!(
        recorder.recording.parameters.iter().any(|(name, _)| name == "COMPASS_OFS_X"),
        "it says that nothing is applied"
    );
}
