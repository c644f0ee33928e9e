use host_sim::module::Module as _;
use host_sim::nmea::Reader;
use host_sim::rig::Rig;
use host_sim::score::{Errors, wrap_180};
use host_sim::transcript;
use host_sim::world::WorldConfig;
use host_sim::world::autopilot::Leg;
fn main() {
    for seed in 1..9u64 {
        let world = WorldConfig::random(seed);
        let mut rig = Rig::new(world);
        rig.run_for_s(2.0);
        rig.type_line("cal start");
        for s in [1.0, -1.0] {
            rig.world.fly(Leg::Turn { bank_deg: 25.0, heading_change_deg: s * 1440.0 });
        }
        while rig.world.legs_left() > 0 {
            rig.run_for_s(1.0);
        }
        rig.run_for_s(10.0);
        let Some(shown) = transcript::shown(&rig.type_line("cal show")) else {
            println!("{seed} none");
            continue;
        };
        let t = Errors::of(&shown.calibration, &world).figures().rms_deg;
        let mut reader = Reader::default();
        let _ = rig.autopilot.receive();
        for _ in 0..3 {
            rig.world.fly(Leg::Straight { heading_deg: 100.0, seconds: 25.0 });
            rig.world.fly(Leg::Turn { bank_deg: 25.0, heading_change_deg: 360.0 });
        }
        let (mut n, mut e2, mut s2, mut e1) = (0.0, 0.0, 0.0, 0.0);
        let mut slow = [0.0f64; 3];
        let t0 = rig.now_us();
        while rig.world.legs_left() > 0 {
            rig.run_for_s(0.5);
            for timed in rig.autopilot.receive_timed() {
                if let Some(r) = reader
                    .push(timed.at_us, timed.byte)
                    .filter(|r| r.kind == "PASWH" && r.told.as_deref() == Some("smooth"))
                {
                    if timed.at_us < t0 + 10_000_000 {
                        continue;
                    }
                    let e = wrap_180(r.heading_deg.unwrap() - rig.world.true_state(timed.at_us).heading_deg());
                    n += 1.0;
                    e1 += e;
                    e2 += e * e;
                    s2 += r.sigma_deg.unwrap().powi(2);
                    let _ = &mut slow;
                }
            }
        }
        println!(
            "{seed} incl {:.0} cal true {:.2} exp {:.2}; smooth rms {:.2} mean {:.2} sigma {:.2} n {n}",
            world.earth.inclination_deg,
            t,
            shown.expected_rms_deg,
            (e2 / n as f64).sqrt(),
            e1 / n,
            (s2 / n as f64).sqrt()
        );
    }
}
