//! Talks to a person, or to a script.

use embassy_futures::select::{Either3, select3};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};

use super::{Links, Platform};
use crate::compass::{Command, Refusal, Reply};
use crate::console::session::Session;
use crate::console::{LineError, Request, help, report};
use crate::health::{Counts, Health, Loss, ResetCause};
use crate::instrument::Estimate;

/// A terminal that takes nothing for so long loses what was to be shown.
const WRITE_PATIENCE: Duration = Duration::from_millis(500);

/// A line in error is left alone for a byte or two, so that it cannot take all the time there is.
const PAUSE: Duration = Duration::from_micros(200);

/// The reply to `reboot` gets so long to leave the port.
const LAST_WORDS: Duration = Duration::from_millis(50);

/// Runs the console for ever.
pub async fn run(
    links: &Links,
    mut rx: impl Read,
    mut tx: impl Write,
    mut platform: impl Platform,
    reset: ResetCause,
) -> ! {
    let session = Session::new(|out| report::greeting(out, &reset));
    let mut talk = Talk { links, session, began: Counts::default() };
    let mut bytes = [0; 32];
    loop {
        drain(&mut talk.session, &mut tx).await;
        match select3(rx.read(&mut bytes), links.notices.wait(), links.iron.wait()).await {
            Either3::First(Ok(read)) if read > 0 => {
                for &byte in bytes.get(..read).unwrap_or_default() {
                    if let Some(entered) = talk.session.byte(byte) {
                        talk.answer(entered, &mut platform, &reset, &mut tx).await;
                    }
                    drain(&mut talk.session, &mut tx).await;
                }
            }
            Either3::First(_) => Timer::after(PAUSE).await,
            Either3::Second(outcome) => {
                let loss = talk.loss();
                talk.session.notice(|out| report::outcome(out, &outcome, loss));
            }
            Either3::Third(iron) => talk.session.notice(|out| report::iron(out, iron.as_ref())),
        }
    }
}

/// A terminal, and what it is told of.
struct Talk<'a> {
    links: &'a Links,
    session: Session,
    /// What had been counted when the collection began.
    began: Counts,
}

impl Talk<'_> {
    /// Carries out what a line asks for and writes the reply.
    async fn answer(
        &mut self,
        entered: Result<Request, LineError>,
        platform: &mut impl Platform,
        reset: &ResetCause,
        tx: &mut impl Write,
    ) {
        let session = &mut self.session;
        match entered {
            Err(error) => session.reply(|out| report::line_error(out, &error)),
            Ok(Request::Help(of)) => session.reply(|out| help(out, of)),
            Ok(Request::Version) => session.reply(report::version),
            Ok(Request::Reboot) => match ask(self.links, Command::Restart).await {
                Ok(_) => {
                    session.reply(|out| core::fmt::Write::write_str(out, "ok restarting\n"));
                    drain(session, tx).await;
                    Timer::after(LAST_WORDS).await;
                    platform.reboot();
                }
                refused => self.reply(&refused),
            },
            Ok(Request::CalShow) => match ask(self.links, Command::Report).await {
                Ok(Reply::Report(found)) => session.reply(|out| report::calibration(out, &found)),
                other => self.reply(&other),
            },
            Ok(Request::Status) => match ask(self.links, Command::Report).await {
                Ok(Reply::Report(found)) => {
                    let health = health(self.links, &self.began, reset, platform);
                    session.reply(|out| report::status(out, &found, &health));
                }
                other => self.reply(&other),
            },
            Ok(Request::Compass(command)) => self.command(command).await,
        }
    }

    /// Asks the state machine, and tells what it answers.
    async fn command(&mut self, command: Command) {
        let mut answer = ask(self.links, command).await;
        match (command, &answer) {
            (Command::CalStart(_), Ok(_)) => self.began = self.links.counts(),
            // What is in force now is told, not what was typed.
            (Command::Set(_) | Command::Align(_) | Command::AlignSurely(_) | Command::CalUndo, Ok(_)) => {
                answer = ask(self.links, Command::Report).await;
            }
            _ => {}
        }
        match answer {
            Ok(Reply::Report(found)) => self.session.reply(|out| report::changed(out, command, &found)),
            other => self.reply(&other),
        }
    }

    fn reply(&mut self, reply: &Result<Reply, Refusal>) {
        let loss = self.loss();
        match reply {
            Ok(done) => self.session.reply(|out| report::done(out, done)),
            Err(refusal) => self.session.reply(|out| report::refusal(out, refusal, loss)),
        }
    }

    /// What was lost of the readings since the collection began.
    fn loss(&self) -> Option<Loss> {
        Loss::between(&self.began, &self.links.counts())
    }
}

/// Asks the state machine. It answers within one step of a solve or one save.
async fn ask(links: &Links, command: Command) -> Result<Reply, Refusal> {
    links.requests.send(command).await;
    links.replies.receive().await
}

fn health(links: &Links, began: &Counts, reset: &ResetCause, platform: &impl Platform) -> Health {
    let counts = links.counts();
    let Estimate { attitude, heading, iron, .. } = links.estimates.try_get().unwrap_or(Estimate::NOTHING);
    Health {
        sensor: links.sensor.try_get().map(|found| found.identity),
        attitude,
        heading,
        iron,
        loss: Loss::between(began, &counts),
        counts,
        reset: reset.clone(),
        uptime_s: Instant::now().as_secs() as u32,
        stack: platform.stack(),
    }
}

/// Sends what has been written.
async fn drain(session: &mut Session, tx: &mut impl Write) {
    if !session.output().is_empty() {
        // A terminal that takes nothing loses it: see `WRITE_PATIENCE`.
        let _ = with_timeout(WRITE_PATIENCE, tx.write_all(session.output())).await;
        session.sent();
    }
}
