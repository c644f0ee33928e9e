//! Safe mode: console, ports and watchdog without any other task.

use std::cell::Cell;
use std::rc::Rc;

use testkit::flash::SilentFault;

use super::TaskBench;
use super::devices::{DeviceBehaviour, Port};
use super::thread_tasks::{Flash, PAGES, ask, store, with_compass};
use crate::app::watchdog::MAX_FEED_INTERVAL_US;
use crate::app::{Watchdog, safe_mode};
use crate::compass::{Command, ModuleState, Reply};
use crate::messages::{Message, Refusal};
use crate::settings::{SettingChange, Settings};
use crate::store::StoreError;

/// Longest time between feeds, and time of the last one.
#[derive(Clone, Default)]
struct FeedTimer(Rc<Cell<(u64, u64)>>);

impl Watchdog for FeedTimer {
    fn feed(&mut self) {
        let (longest_us, last_us) = self.0.get();
        let now_us = embassy_time::Instant::now().as_micros();
        self.0.set((longest_us.max(now_us - last_us), now_us));
    }
}

fn with_safe_mode(flash: Flash) -> (TaskBench, [Port; 2], FeedTimer) {
    let mut bench = TaskBench::new();
    let (ports, timer) = (<[Port; 2]>::default(), FeedTimer::default());
    let (lines, watchdog) = (ports.clone(), timer.clone());
    bench.run("safe mode", |links| async move {
        Box::pin(safe_mode::run(&links, store(flash), lines, watchdog)).await;
    });
    bench.ms(1);
    (bench, ports, timer)
}

/// No message of a port or of the console is needed; MAVLink's parser finds both messages among the sentences.
#[test]
fn both_ports_report_it_in_both_protocols() {
    let (mut bench, ports, _) = with_safe_mode(Flash::new(PAGES));
    assert_eq!(bench.links.notices.try_receive(), Ok(Message::SafeMode));
    bench.ms(1_000);
    for port in &ports {
        let bytes = port.written.take();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert_eq!(text.matches("$PASWH,,,safe-mode,*").count(), 2, "{text}");
        assert_eq!(text.matches("$HCHDM,,M*07\r\n").count(), 2, "{text}");
        assert_eq!(text.matches("autoswing: safe-mode: ").count(), 1, "{text}");
        // HEARTBEAT (9 bytes, from 1/158), type, no autopilot, and MAV_STATE_CRITICAL (mavlink.io).
        let beat = |frame: &&[u8]| frame[1] == 9 && frame[5..10] == [1, 158, 0, 0, 0] && frame[15..18] == [8, 0, 5];
        let frames = bytes.windows(20).filter(|window| window[0] == 0xFD);
        assert_eq!(frames.filter(beat).count(), 2, "{bytes:?}");
    }
}

/// One page of the store holds anything; all other commands are refused.
#[test]
fn it_erases_the_store_and_refuses_other_commands() {
    let flash = Flash::new(PAGES);
    let mut before = with_compass(flash.clone());
    assert!(ask(&mut before, Command::Set(SettingChange::StreamRateHz(20))).is_ok());
    let (mut bench, ..) = with_safe_mode(flash.clone());
    assert!(matches!(ask(&mut bench, Command::Status), Ok(Reply::SafeMode)));
    assert!(matches!(ask(&mut bench, Command::CalSolve(None)), Err(Refusal::SafeMode)));
    assert!(matches!(ask(&mut bench, Command::CalClear), Ok(Reply::Done(ModuleState::Uncalibrated))));
    assert!(ask(&mut bench, Command::Restart).is_ok() && bench.links.restart.signaled());
    assert_eq!(with_compass(flash).links.settings.try_get(), Some(Settings::DEFAULT));
}

/// Ports that accept nothing, and a flash that never completes an erase.
#[test]
fn broken_devices_do_not_starve_the_watchdog() {
    let mut flash = Flash::new(PAGES);
    flash.silent_fault = Some(SilentFault::Hangs);
    let (mut bench, ports, timer) = with_safe_mode(flash);
    for port in &ports {
        port.mood.set(DeviceBehaviour::Hangs);
    }
    for _ in 0..20 {
        bench.links.commands.try_send((crate::app::links::CommandSource::Console, Command::CalClear)).unwrap();
        bench.ms(937);
        assert!(matches!(bench.links.replies.try_receive(), Ok(Err(Refusal::Store(StoreError::Timeout)))));
    }
    let (longest_us, last_us) = timer.0.get();
    assert!(longest_us <= MAX_FEED_INTERVAL_US && last_us > 18_000_000, "{longest_us} {last_us}");
}
