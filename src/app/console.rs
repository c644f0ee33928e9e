//! Talks to a person, or to a script.

use core::fmt::{self, Write as _};

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};

use super::links::Text;
use super::{Links, Platform};
use crate::compass::{Command, Outcome, Refusal, Reply};
use crate::console::session::Session;
use crate::console::{Request, help, report};
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
    let mut talk = Talk { links, session, reset, began: Counts::default() };
    let mut bytes = [0; 32];
    let mut read = 0..0;
    // One place for each wait: each has its state in this task's memory, and its way there in flash.
    loop {
        drain(&mut talk.session, &mut tx).await;
        if let Some(&byte) = read.next().and_then(|next| bytes.get(next)) {
            let Some(request) = talk.byte(byte) else { continue };
            let answer = ask(links, command(request)).await;
            let restarts = matches!((request, &answer), (Request::Reboot, Ok(_)));
            let answer = if is_told(request) && answer.is_ok() { ask(links, Command::Report).await } else { answer };
            talk.answer(request, answer, &platform);
            if restarts {
                links.restart.signal(());
            }
            continue;
        }
        match select4(links.restart.wait(), rx.read(&mut bytes), links.notices.wait(), links.iron.wait()).await {
            Either4::First(()) => {
                Timer::after(LAST_WORDS).await;
                platform.reboot();
            }
            Either4::Second(Ok(number)) if number > 0 => read = 0..number,
            Either4::Second(_) => Timer::after(PAUSE).await,
            Either4::Third(outcome) => talk.outcome(&outcome),
            Either4::Fourth(iron) => talk.note(&|mut out| report::iron(&mut out, iron.as_ref())),
        }
    }
}

/// What a request asks of the state machine.
const fn command(request: Request) -> Command {
    match request {
        Request::Reboot => Command::Restart,
        Request::Compass(command) => command,
        Request::Help(_) | Request::Version | Request::Status | Request::CalShow => Command::Report,
    }
}

/// Whether what is in force afterwards is told, rather than what was typed.
const fn is_told(request: Request) -> bool {
    use Command::{Align, AlignSurely, CalUndo, Set};
    matches!(request, Request::Compass(Set(_) | Align(_) | AlignSurely(_) | CalUndo))
}

/// A terminal, and what it is told of.
struct Talk<'a> {
    links: &'a Links,
    session: Session,
    reset: ResetCause,
    /// What had been counted when the collection began.
    began: Counts,
}

impl Talk<'_> {
    /// Takes a byte; gives a request that the state machine is to be asked about.
    #[inline(never)]
    fn byte(&mut self, byte: u8) -> Option<Request> {
        match self.session.byte(byte)? {
            Err(error) => self.session.reply(|out| report::line_error(out, &error)),
            Ok(Request::Help(of)) => self.session.reply(|out| help(out, of)),
            Ok(Request::Version) => self.session.reply(report::version),
            Ok(request) => return Some(request),
        }
        None
    }

    /// Tells what the state machine answers to a request.
    #[inline(never)]
    fn answer(&mut self, request: Request, answer: Result<Reply, Refusal>, platform: &impl Platform) {
        if let (Request::Compass(Command::CalStart(_)), Ok(_)) = (request, &answer) {
            self.began = self.links.counts();
        }
        let health = self.health(platform);
        self.session.reply(|out| match (answer, request) {
            (Err(refusal), _) => report::refusal(out, &refusal, health.loss),
            (Ok(_), Request::Reboot) => out.write_str("ok restarting\n"),
            (Ok(Reply::Report(found)), Request::Status) => report::status(out, &found, &health),
            (Ok(Reply::Report(found)), Request::Compass(command)) => report::changed(out, command, &found),
            (Ok(Reply::Report(found)), _) => report::calibration(out, &found),
            (Ok(done), _) => report::done(out, &done),
        });
    }

    /// Tells how a solve has ended.
    #[inline(never)]
    fn outcome(&mut self, outcome: &Outcome) {
        let loss = Loss::between(&self.began, &self.links.counts());
        self.note(&|mut out| report::outcome(&mut out, outcome, loss));
    }

    /// Tells something that nobody has asked for, here and on the ports.
    #[inline(never)]
    fn note(&mut self, write: &dyn Fn(&mut dyn fmt::Write) -> fmt::Result) {
        self.session.notice(|out| write(out));
        let mut text = Text::new();
        // A port tells as much as fits.
        let _ = write(&mut text);
        self.links.texts.sender().send(text);
    }

    fn health(&self, platform: &impl Platform) -> Health {
        let Estimate { attitude, heading, iron, current_a, .. } =
            self.links.estimates.try_get().unwrap_or(Estimate::NOTHING);
        let counts = self.links.counts();
        Health {
            sensor: self.links.sensor.try_get().map(|found| found.identity),
            attitude,
            heading,
            iron,
            current_a,
            loss: Loss::between(&self.began, &counts),
            counts,
            reset: self.reset.clone(),
            uptime_s: Instant::now().as_secs() as u32,
            stack: platform.stack(),
            ports: self.links.spoken(),
        }
    }
}

/// Asks the state machine. It answers within one step of a solve or one save.
async fn ask(links: &Links, command: Command) -> Result<Reply, Refusal> {
    links.requests.send(command).await;
    links.replies.receive().await
}

/// Sends what has been written.
async fn drain(session: &mut Session, tx: &mut impl Write) {
    if !session.output().is_empty() {
        // A terminal that takes nothing loses it: see `WRITE_PATIENCE`.
        let _ = with_timeout(WRITE_PATIENCE, tx.write_all(session.output())).await;
        session.sent();
    }
}
