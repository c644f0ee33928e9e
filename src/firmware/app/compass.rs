//! Task of the state machine: passes samples and requests to it, runs solves in steps, writes to flash.

use core::future::poll_fn;
use core::pin::{Pin, pin};
use core::sync::atomic::Ordering;
use core::task::{Context, Poll};

use embassy_futures::select::select_array;
use embassy_futures::{poll_once, yield_now};
use embassy_time::{Duration, with_timeout};
use embedded_storage_async::nor_flash::NorFlash;

use super::task_links::{
    CommandSource, SensorDetection, Timestamped, ValueReceiver, apply_atomically, increment_counter, now,
    publish_value, subscribe,
};
use crate::app::task_links::TaskLinks;
use crate::health::{EventCounts, main_sample_loss};
use crate::log::{info, warning};
use autoswing::attitude::HAS_OWN_ATTITUDE;
use autoswing::collection::RetainedSamples;
use autoswing::earth::{Date, Position};
use autoswing::instrument::readings_per_sample;
use autoswing::time::Timestamp;
use autoswing_module::compass::{Command, Compass, Effect, Event, Reply};
use autoswing_module::messages::Message;
use autoswing_module::messages::SampleLoss;
use autoswing_module::store::{LoadedValues, Store, StoreError};

/// Longest wait for an event: the heartbeat interval of the idle state machine.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(200);

/// Timeout of a save: twice the longest, `cal clear all` of a store of another format, which erases each page in 25 ms.
const SAVE_TIMEOUT: Duration = Duration::from_millis(500);

/// Longest time between heartbeats of this task, milliseconds. One step of a solve takes 0.1 s.
pub(super) const MAX_HEARTBEAT_INTERVAL_MS: u64 = SAVE_TIMEOUT.as_millis() + 100;

/// Loads the flash contents and the retained collection, then runs the state machine for ever.
pub async fn run_compass<F: NorFlash>(
    links: &TaskLinks,
    mut store: Store<F>,
    retained_samples: &mut RetainedSamples,
) -> ! {
    // The loaded data is dropped at the end of this block and takes no room in this task's memory afterwards.
    let mut compass = {
        let LoadedValues { stored_values: stored, load_error: error } =
            poll_in_own_stack_frame(pin!(store.load_state())).await;
        if let Some(error) = error {
            report_unreadable_flash(links, error);
        }
        links.set_initial_protocols(stored.startup_values.detected_protocols);
        Compass::new(&stored, retained_samples)
    };
    if let Some(loss_message) = compass.last_collection_outcome() {
        links.broadcast_message(loss_message);
    }
    run_state_machine(links, &mut store, &mut compass).await
}

/// Runs the state machine for ever. It is passed by reference: created here, it would be built on the stack, which has
/// no room for it, and copied.
async fn run_state_machine<F: NorFlash>(links: &TaskLinks, store: &mut Store<F>, compass: &mut Compass<'_>) -> ! {
    let mut events = CompassEvents::new(links);
    let mut loss_counts = LossCounts::default();
    publish_state(links, compass, None);
    if HAS_OWN_ATTITUDE {
        links.sensor_offsets.sender().send(compass.sensor_offsets());
    }
    loop {
        increment_counter(&links.heartbeats.compass);
        loss_counts.renew(links);
        let (event, source) = if compass.needs_solve_step() {
            // The console runs between two steps of a solve.
            yield_now().await;
            match poll_once(events.next_event()) {
                Poll::Ready(received_event) => received_event,
                Poll::Pending => (Event::AdvanceSolve, None),
            }
        } else if let Ok(received_event) = with_timeout(HEARTBEAT_INTERVAL, events.next_event()).await {
            received_event
        } else {
            continue;
        };
        if HAS_OWN_ATTITUDE
            && links.event_counters.inertial_readings.load(Ordering::Relaxed) > 0
            && let Some(offsets) = links.sensor_offsets.try_get()
        {
            compass.set_sensor_offsets(offsets);
        }
        let mut effect = compass.process_event(event);
        if is_cal_start(event) && matches!(effect, Effect::Reply(Ok(_))) {
            loss_counts = LossCounts::started_with(links.event_counts());
        }
        if let Effect::None = effect {
            effect = compass.process_event(Event::ProtocolsDetected(links.port_protocols(), now().wrapping_millis()));
        }
        while let (Effect::Save, Some(change)) = (&effect, compass.pending_change()) {
            let result = with_timeout(SAVE_TIMEOUT, poll_in_own_stack_frame(pin!(store.save_change(change))))
                .await
                .unwrap_or(Err(StoreError::Timeout));
            increment_counter(if result.is_ok() {
                &links.event_counters.saves
            } else {
                &links.event_counters.store_errors
            });
            effect = compass.process_event(Event::Saved(result));
        }
        let attitude_source = compass.stored_settings().attitude_source;
        let counts = links.event_counts();
        let loss_since = |before| main_sample_loss(before, &counts, attitude_source);
        add_sample_loss(&mut effect, loss_since(&loss_counts.at_start), loss_since(&loss_counts.recent[0]));
        let message = if let Effect::Notify(message) = &effect { Some(message) } else { None };
        // The state is published before the reply, so that the reader of the reply finds the state that it names.
        publish_state(links, compass, message);
        if let (Effect::Reply(reply), Event::Command(command, _), Some(source)) = (effect, event, source) {
            // The console restarts the module after its reply, for a command from any source.
            if command == Command::Restart && reply.is_ok() {
                links.restart_request.signal(());
            }
            if let (Command::Autopilot(action), true) = (command, reply.is_ok()) {
                links.pass_autopilot_action(action);
            }
            links.send_reply(source, command, reply);
        }
    }
}

const fn is_cal_start(event: Event) -> bool {
    matches!(event, Event::Command(Command::CalStart(_) | Command::CalStartNew(_), _))
}

/// Earlier event counts, from which lost readings are counted.
#[derive(Default)]
struct LossCounts {
    at_start: EventCounts,
    /// Counts of two successive renewals.
    recent: [EventCounts; 2],
    renewed_at: Timestamp,
}

/// Interval between two renewals of the recent counts, microseconds: `status` counts readings of the last 5 to 10 s.
const RENEWAL_INTERVAL_US: u64 = 5_000_000;

impl LossCounts {
    fn started_with(counts: EventCounts) -> Self {
        Self { at_start: counts, recent: [counts; 2], renewed_at: now() }
    }

    fn renew(&mut self, links: &TaskLinks) {
        let at = now();
        if at.us_since(self.renewed_at) >= RENEWAL_INTERVAL_US {
            (self.recent, self.renewed_at) = ([self.recent[1], links.event_counts()], at);
        }
    }
}

/// Adds recently lost readings to a report, and those since the start of the collection to a refusal that they can have caused.
fn add_sample_loss(effect: &mut Effect, since_start: Option<SampleLoss>, recent: Option<SampleLoss>) {
    match effect {
        Effect::Reply(Err(refusal)) => *refusal = refusal.clone().with_cause(since_start),
        Effect::Reply(Ok(Reply::Report(report))) => {
            report.sample_loss = recent;
            report.last_collection_outcome =
                report.last_collection_outcome.take().map(|outcome| outcome.with_cause(since_start));
        }
        Effect::Notify(message) => *message = message.clone().with_cause(since_start),
        Effect::Reply(Ok(_)) | Effect::None | Effect::Save => {}
    }
}

/// Polls a future in a separate stack frame: the store's buffers are large and would otherwise enlarge this task's
/// frame, which also holds a solve. The caller pins the future; passed by value it would exist twice, 6 KB each.
async fn poll_in_own_stack_frame<F: Future>(mut future: Pin<&mut F>) -> F::Output {
    #[inline(never)]
    fn poll<F: Future>(future: Pin<&mut F>, context: &mut Context<'_>) -> Poll<F::Output> {
        future.poll(context)
    }
    poll_fn(|context| poll(future.as_mut(), context)).await
}

/// The state machine's events from all other tasks, in one sequence.
struct CompassEvents<'a> {
    links: &'a TaskLinks,
    armed_receiver: ValueReceiver<'a, Option<bool>, 1>,
    sensor_receiver: ValueReceiver<'a, SensorDetection, 2>,
    position_receiver: ValueReceiver<'a, Timestamped<Position>, 1>,
    date_receiver: ValueReceiver<'a, Date, 1>,
}

impl<'a> CompassEvents<'a> {
    fn new(links: &'a TaskLinks) -> Self {
        Self {
            links,
            armed_receiver: subscribe(&links.armed_state),
            sensor_receiver: subscribe(&links.sensor),
            position_receiver: subscribe(&links.position),
            date_receiver: subscribe(&links.date),
        }
    }

    /// Waits for the next event, and the source of a command. Of several that are ready, the first in this list is
    /// next: the armed state, because commands depend on it.
    async fn next_event(&mut self) -> (Event, Option<CommandSource>) {
        let Self {
            links,
            armed_receiver: armed,
            sensor_receiver: sensor,
            position_receiver: position,
            date_receiver: date,
        } = self;
        let events: [Pin<&mut dyn Future<Output = _>>; 6] = [
            pin!(async { (Event::ArmedStateReported(armed.changed().await), None) }),
            pin!(async {
                let (source, command) = links.commands.receive().await;
                (Event::Command(command, now().wrapping_millis()), Some(source))
            }),
            pin!(async {
                let SensorDetection { identity, period_us, .. } = sensor.changed().await;
                (Event::SensorDetected(identity, readings_per_sample(period_us)), None)
            }),
            pin!(async { (Event::Sample(links.samples.receive().await), None) }),
            pin!(async {
                let Timestamped { timestamp: at, value } = position.changed().await;
                (Event::Position(value, at.wrapping_millis()), None)
            }),
            pin!(async { (Event::Date(date.changed().await), None) }),
        ];
        select_array(events).await.0
    }
}

/// Counts and reports unreadable flash; the module starts without stored data.
fn report_unreadable_flash(links: &TaskLinks, error: StoreError) {
    let message = Message::StoreFailed(error);
    warning!("load: {=str}", message.stable_code());
    increment_counter(&links.event_counters.store_errors);
    links.broadcast_message(&message);
}

/// Publishes the state to the other tasks. A port receives a message together with the state after it: a collection
/// that ends without a message was aborted.
fn publish_state(links: &TaskLinks, compass: &Compass<'_>, message: Option<&Message>) {
    publish_value(&links.correction, compass.instrument_correction());
    publish_value(&links.stored_settings, *compass.stored_settings());
    publish_value(&links.settings, compass.effective_settings());
    let indicator_state = compass.indicator_state();
    if let Some(message) = message {
        info!("message: {=str}", message.stable_code());
    }
    apply_atomically(|| {
        if let Some(message) = message {
            links.broadcast_message(message);
        }
        publish_value(&links.indicator_state, indicator_state);
    });
}
