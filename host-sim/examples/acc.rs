use autoswing::calibration::{Method, Prior, solve};
use host_sim::accuracy::{bound, trial::*};
fn main() {
    let n: u64 = std::env::args().nth(1).map_or(100, |a| a.parse().unwrap());
    let reps: u64 = std::env::args().nth(2).map_or(30, |a| a.parse().unwrap());
    let mut ratios = vec![];
    let mut fails = 0;
    let mut wrong = 0;
    let mut fc = vec![];
    let mut ranges = Ranges::HARSH;
    let which = std::env::args().nth(3).unwrap_or_default();
    if which == "s" {
        ranges.attitude_noise_deg = [0.01, 0.02];
    }
    if which == "a" {
        ranges.sensor_noise = [0.0003, 0.0004];
    }
    for seed in 0..n {
        let t = Trial::draw(&ranges, seed);
        let Some(bound) = bound::rms_deg(&t) else {
            println!("{seed} no bound");
            continue;
        };
        let mut sum = vec![0.0; 36];
        let mut ss = 0.0;
        let mut k = 0.0;
        let mut ex = 0.0;
        for r in 0..reps {
            let rec = t.record(r);
            match solve(Method::MaximumLikelihood, rec.samples(), &Prior::default()) {
                Ok(s) => {
                    let e = t.errors_deg(&s.calibration);
                    let ms = e.iter().map(|x| x * x).sum::<f64>() / e.len() as f64;
                    ss += ms;
                    k += 1.0;
                    for (a, b) in sum.iter_mut().zip(&e) {
                        *a += b;
                    }
                    let exp = f64::from(s.quality.expected_rms_deg);
                    ex += exp;
                    fc.push(ms / exp / exp);
                    if exp <= 3.0 && ms.sqrt() > 3.0 * exp {
                        wrong += 1;
                        println!("wrong {seed}/{r}: {} exp {}", ms.sqrt(), exp);
                    }
                }
                Err(e) => {
                    fails += 1;
                    println!("fail {seed}/{r}: {e:?} bound {bound}");
                }
            }
        }
        let ratio = (ss / k).sqrt() / bound;
        let bias = (sum.iter().map(|x: &f64| (x / k) * (x / k)).sum::<f64>() / 36.0).sqrt() / bound;
        let bank = t.right.iter().map(|i| i.roll_rad).sum::<f64>().to_degrees() / t.right.len() as f64;
        ratios.push((
            ratio,
            seed,
            bound,
            ex / k,
            [bias, t.inclination_rad.to_degrees(), bank, t.sensor_sigma * 100., t.attitude_sigma_rad.to_degrees()],
        ));
    }
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let q = |f: f64| ratios[((ratios.len() - 1) as f64 * f) as usize];
    println!(
        "ratio 10% {:?} median {:?} 90% {:?} worst {:?}; fails {fails} wrong {wrong}; mean sq forecast {}",
        q(0.1),
        q(0.5),
        q(0.9),
        q(1.0),
        fc.iter().sum::<f64>() / fc.len() as f64
    );
    for r in ratios.iter().rev().take(12) {
        println!("{r:?}");
    }
    let mut b: Vec<f64> = ratios.iter().map(|r| r.2).collect();
    b.sort_by(f64::total_cmp);
    println!("bounds: median {} 90% {} max {}", b[b.len() / 2], b[b.len() * 9 / 10], b[b.len() - 1]);
}
