//! The command line of the simulator.
fn main() {
    let seed: u64 = std::env::args().nth(1).map_or(1, |s| s.parse().unwrap());
    let world = if seed == 0 { host_sim::world::WorldConfig::table1(0) } else { host_sim::world::WorldConfig::random(seed) };
    let flown = host_sim::mission::fly(world, Default::default(), &mut |_, _| {});
    println!("{}", flown.session);
    println!("{:?}\n{:?}\n{:?}\n{:?}", flown.result, flown.before.figures(), flown.after.figures(), flown.streamed);
}
