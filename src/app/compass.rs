//! Drives the state machine: feeds it samples and requests, runs its solves in steps, writes its saves.

use core::future::poll_fn;
use core::pin::{Pin, pin};
use core::task::{Context, Poll};

use embassy_futures::select::{Either, Either6, select, select6};
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;

use super::Links;
use super::links::{FoundSensor, Listener, count, listen, now, publish};
use crate::acceptance::Policy;
use crate::calibration::ladder::Procedure;
use crate::collection::Kept;
use crate::compass::{Command, Compass, Effect, Event, Refusal};
use crate::earth::{Day, Place};
use crate::instrument::readings_per_sample;
use crate::log::{info, warning};
use crate::port::Order;
use crate::settings::PortNumber;
use crate::store::{Store, StoreError};

/// Loads what flash holds, and the collection that the memory does, then runs the state machine for ever.
pub async fn run<F: NorFlash>(links: &Links, mut store: Store<F>, kept: &mut Kept) -> ! {
    // What was stored has no place in this task's memory once the machine has it.
    let mut compass = {
        let stored = apart(pin!(store.load())).await;
        if let Err(error) = stored {
            say_unreadable(links, error);
        }
        let stored = stored.unwrap_or_default();
        links.begin_with(stored.remembered.found);
        Compass::new(Policy::DEFAULT, &stored, kept)
    };
    if let Some(lost) = compass.last() {
        links.notices.signal(lost.clone());
    }
    drive(links, &mut store, &mut compass).await
}

/// Runs the machine for ever. It is made where it stays, by whoever calls this: one that is used where it is made was seen to
/// be made on the stack, which has no room for it, and copied.
async fn drive<F: NorFlash>(links: &Links, store: &mut Store<F>, compass: &mut Compass<'_>) -> ! {
    let mut latest = LatestOf {
        armed: listen(&links.armed),
        sensor: listen(&links.sensor),
        place: listen(&links.place),
        day: listen(&links.day),
    };
    loop {
        tell(links, compass);
        let (event, asker) = next_event(links, compass, &mut latest).await;
        let mut effect = compass.step(event);
        if let Effect::None = effect {
            effect = compass.step(Event::Spoken(links.spoken(), now().wrapping_millis()));
        }
        while let (Effect::Save, Some(change)) = (&effect, compass.to_save()) {
            let result = apart(pin!(store.save(change))).await;
            count(if result.is_ok() { &links.counters.saves } else { &links.counters.store_errors });
            effect = compass.step(Event::Saved(result));
        }
        // Before the reply: whoever reads it finds the module as it says.
        tell(links, compass);
        match effect {
            Effect::Reply(reply) => match asker {
                Asker::Person => links.replies.send(reply).await,
                Asker::Port(number, order) => answer(links, number, order, reply.map(|_| ())),
                // Who pressed the button sees the lamp.
                Asker::Nobody => {}
            },
            Effect::Notify(outcome) => {
                info!("solve ended, ok {=bool}", outcome.is_ok());
                links.notices.signal(outcome);
            }
            Effect::None | Effect::Save => {}
        }
    }
}

/// Polls a future in a stack frame of its own. What the store takes from flash is large, and would otherwise have its
/// place in this task's frame, beside all that a solve needs. It is pinned by the caller: of one that is passed by value
/// there would be two places, 6 KB each.
async fn apart<F: Future>(mut future: Pin<&mut F>) -> F::Output {
    #[inline(never)]
    fn poll<F: Future>(future: Pin<&mut F>, context: &mut Context<'_>) -> Poll<F::Output> {
        future.poll(context)
    }
    poll_fn(|context| poll(future.as_mut(), context)).await
}

/// Who waits for a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asker {
    Person,
    Port(PortNumber, Order),
    Nobody,
}

/// What is asked for on a port, in the state machine's words.
const fn ordered(order: Order) -> Command {
    match order {
        Order::Start => Command::CalStart(Procedure::Flight),
        Order::Accept => Command::CalSolve(None),
        Order::Cancel => Command::CalAbort,
        Order::Reboot => Command::Restart,
    }
}

fn answer(links: &Links, number: PortNumber, order: Order, result: Result<(), Refusal>) {
    if order == Order::Reboot && result.is_ok() {
        links.restart.signal(());
    }
    links.port(number).answers.signal((order, result));
}

/// This task's ends of wires that hold a latest value.
struct LatestOf<'a> {
    armed: Listener<'a, Option<bool>, 1>,
    sensor: Listener<'a, FoundSensor, 2>,
    place: Listener<'a, Place, 1>,
    day: Listener<'a, Day, 1>,
}

/// Waits for what happens next; while the machine is busy that is its next step, unless something else has happened.
/// Of what has happened, whether the autopilot is armed comes first: a command is judged by it. Place and day wait for the
/// end of a solve, which has taken from them what it needs.
async fn next_event(links: &Links, compass: &Compass<'_>, latest: &mut LatestOf<'_>) -> (Event, Asker) {
    let LatestOf { armed, sensor, place, day } = latest;
    let asked = |asked| (command(asked), Asker::Person);
    let of = |event| (event, Asker::Nobody);
    let from = |(number, order)| (command(ordered(order)), Asker::Port(number, order));
    if compass.is_busy() {
        // Between two steps of a solve the console gets its turn.
        yield_now().await;
        let armed = armed.try_changed().map(|armed| of(Event::Armed(armed)));
        let request = || links.requests.try_receive().ok().map(asked);
        let order = || links.orders.try_receive().ok().map(from);
        return armed.or_else(request).or_else(order).unwrap_or(of(Event::Advance));
    }
    let next = select6(
        armed.changed(),
        links.requests.receive(),
        links.orders.receive(),
        sensor.changed(),
        links.pressed.wait(),
        select(links.samples.receive(), select(place.changed(), day.changed())),
    );
    match next.await {
        Either6::First(is_armed) => of(Event::Armed(is_armed)),
        Either6::Second(request) => asked(request),
        Either6::Third(order) => from(order),
        Either6::Fourth(found) => of(Event::SensorFound(found.identity, readings_per_sample(found.period_us))),
        Either6::Fifth(()) => of(command(Command::CalStart(Procedure::Flight))),
        Either6::Sixth(Either::First(sample)) => of(Event::Sample(sample)),
        Either6::Sixth(Either::Second(Either::First(place))) => of(Event::Place(place)),
        Either6::Sixth(Either::Second(Either::Second(day))) => of(Event::Day(day)),
    }
}

fn command(asked: Command) -> Event {
    Event::Command(asked, now().wrapping_millis())
}

/// What cannot be read is counted, said on the console and treated as absent: the module starts uncalibrated.
fn say_unreadable(links: &Links, error: StoreError) {
    warning!("load: {=str}", error.code());
    count(&links.counters.store_errors);
    links.notices.signal(Err(Refusal::Store(error)));
}

/// Tells the other tasks what has changed for them.
fn tell(links: &Links, compass: &Compass<'_>) {
    publish(&links.correction, compass.correction());
    publish(&links.settings, compass.settings_in_force());
    publish(&links.glance, compass.glance());
}
