//! Table of the console's commands, for parsing, completion, help and errors.
//!
//! A new command is one more row. The commands `set` of settings derive from their table ([`SETTINGS`]), and come last.

use autoswing::calibration::Method;
use autoswing::calibration::method_selection::Procedure;
use autoswing_module::compass::{AutopilotAction, Command};
use autoswing_module::settings::{SETTINGS, Setting, SettingValue};

/// Command that is not of settings, or the first word of several commands.
#[derive(Debug)]
pub struct CommandSpec {
    /// One or two words, lower case; the second is empty if there is one.
    pub command_words: [&'static str; 2],
    /// Description in `help`.
    pub help_text: &'static str,
    /// Form of the command.
    pub command_form: CommandForm,
}

/// Form of a command.
#[derive(Debug)]
pub enum CommandForm {
    /// `help`.
    Help,
    /// First word of commands with two.
    Group,
    /// Arguments in their order, and the constructor of the request.
    Request(&'static [ArgumentSpec], fn(&Arguments) -> Request),
}

/// One of all commands.
#[derive(Clone, Copy, Debug)]
pub enum ConsoleCommand {
    /// Command of this module's table.
    Own(&'static CommandSpec),
    /// Change of a setting.
    Setting(&'static Setting),
}

/// Argument of a command.
#[derive(Clone, Copy, Debug)]
pub enum CommandArgument {
    /// Argument of a command of this module's table.
    Own(&'static ArgumentSpec),
    /// Value of a setting. The state machine checks its range.
    Setting(&'static Setting),
}

/// Specification of a command's argument.
#[derive(Debug)]
pub struct ArgumentSpec {
    /// Name of the argument, upper case.
    pub argument_name: &'static str,
    /// Permitted values.
    pub argument_kind: ArgumentKind,
    /// Whether the argument may be omitted.
    pub is_optional: bool,
}

/// Permitted values of an argument.
#[derive(Clone, Copy, Debug)]
pub enum ArgumentKind {
    /// Name with an index.
    Choice(fn(usize) -> Option<&'static str>),
    /// A magnetic heading in degrees, or a word in its place, after which no argument follows. The state machine checks
    /// its range.
    Heading(Option<&'static str>),
    /// Confirmation word.
    Confirmation(&'static str),
}

/// Parsed argument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArgumentValue {
    /// Omitted, or the word in place of a number.
    Absent,
    /// Numeric argument.
    Number(f32),
    /// Index of a choice.
    Choice(usize),
    /// Value of a setting.
    Setting(SettingValue),
}

/// Parsed arguments of a command, two at most.
#[derive(Debug)]
pub struct Arguments(pub [ArgumentValue; 2]);

impl Arguments {
    fn number_argument(&self, index: usize) -> Option<f32> {
        match self.0.get(index) {
            Some(&ArgumentValue::Number(number)) => Some(number),
            _ => None,
        }
    }

    fn choice_argument<T>(&self, index: usize, value_of_index: impl Fn(usize) -> Option<T>) -> Option<T> {
        match self.0.get(index) {
            Some(&ArgumentValue::Choice(number)) => value_of_index(number),
            _ => None,
        }
    }
}

impl CommandSpec {
    const fn new(first_word: &'static str, second_word: &'static str, help_text: &'static str) -> Self {
        Self { command_words: [first_word, second_word], help_text, command_form: CommandForm::Group }
    }

    const fn with_arguments(self, arguments: &'static [ArgumentSpec], to_request: fn(&Arguments) -> Request) -> Self {
        Self { command_form: CommandForm::Request(arguments, to_request), ..self }
    }

    const fn with_request(self, to_request: fn(&Arguments) -> Request) -> Self {
        self.with_arguments(&[], to_request)
    }
}

impl ConsoleCommand {
    /// Words of the command; the second is empty if there is one.
    #[must_use]
    pub const fn words(self) -> [&'static str; 2] {
        match self {
            Self::Own(command) => command.command_words,
            Self::Setting(setting) => ["set", setting.command_word],
        }
    }

    /// Description in `help`.
    #[must_use]
    pub const fn help_text(self) -> &'static str {
        match self {
            Self::Own(command) => command.help_text,
            Self::Setting(setting) => setting.help_text,
        }
    }

    /// Whether the command is the first word of commands with two.
    #[must_use]
    pub const fn is_group(self) -> bool {
        matches!(self, Self::Own(CommandSpec { command_form: CommandForm::Group, .. }))
    }

    /// Argument with this index.
    pub fn nth_argument(self, index: usize) -> Option<CommandArgument> {
        match self {
            Self::Own(CommandSpec { command_form: CommandForm::Request(arguments, _), .. }) => {
                arguments.get(index).map(CommandArgument::Own)
            }
            Self::Own(_) => None,
            Self::Setting(setting) => (index == 0).then_some(CommandArgument::Setting(setting)),
        }
    }

    /// All arguments in their order.
    pub fn arguments(self) -> impl Iterator<Item = CommandArgument> {
        (0..).map_while(move |index| self.nth_argument(index))
    }
}

/// All commands in the order of `help`, adjacent if they share the first word.
pub fn all_commands() -> impl Iterator<Item = ConsoleCommand> {
    let settings = SETTINGS.iter().filter(|setting| !setting.command_word.is_empty());
    COMMANDS.iter().map(ConsoleCommand::Own).chain(settings.map(ConsoleCommand::Setting))
}

impl ArgumentSpec {
    const fn new(name: &'static str, kind: ArgumentKind) -> Self {
        Self { argument_name: name, argument_kind: kind, is_optional: false }
    }

    const fn optional_argument(name: &'static str, kind: ArgumentKind) -> Self {
        Self { argument_name: name, argument_kind: kind, is_optional: true }
    }
}

impl CommandArgument {
    /// Name of the argument, upper case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Own(argument) => argument.argument_name,
            Self::Setting(_) => "VALUE",
        }
    }

    /// Whether the argument may be omitted.
    pub const fn is_optional(self) -> bool {
        matches!(self, Self::Own(ArgumentSpec { is_optional: true, .. }))
    }

    /// Permitted word with this index.
    pub fn nth_word(self, index: usize) -> Option<&'static str> {
        let only_word = match self {
            Self::Setting(setting) => return setting.nth_word(index).map(|(word, _)| word),
            Self::Own(argument) => match argument.argument_kind {
                ArgumentKind::Choice(name) => return name(index),
                ArgumentKind::Heading(alternative) => alternative,
                ArgumentKind::Confirmation(word) => Some(word),
            },
        };
        only_word.filter(|_| index == 0)
    }
}

/// Commands that are not of settings, in the order of `help`.
static COMMANDS: &[CommandSpec] = &[
    CommandSpec {
        command_form: CommandForm::Help,
        ..CommandSpec::new("help", "", "list the commands, or explain one")
    },
    CommandSpec::new("version", "", "show the firmware's version").with_request(|_| Request::Version),
    CommandSpec::new("status", "", "show the state in six lines; all: also settings and counters").with_arguments(
        &[ArgumentSpec::optional_argument("all", ArgumentKind::Confirmation("all"))],
        |arguments| match arguments.0 {
            [ArgumentValue::Choice(_), _] => Command::StatusAll.into(),
            _ => Command::Status.into(),
        },
    ),
    CommandSpec::new("cal", "", "calibration"),
    CommandSpec::new(
        "cal",
        "start",
        "start collecting; flight, turns and level then solve automatically, swing and tumble need cal solve",
    )
    .with_arguments(
        &[
            ArgumentSpec::optional_argument("PROCEDURE", ArgumentKind::Choice(nth_procedure_or_again)),
            ArgumentSpec::optional_argument("again", ArgumentKind::Confirmation("again")),
        ],
        |arguments| match (arguments.0, arguments.choice_argument(0, nth_procedure)) {
            ([ArgumentValue::Choice(AGAIN_INDEX), _] | [_, ArgumentValue::Choice(_)], procedure) => {
                Command::CalStartNew(procedure).into()
            }
            (_, procedure) => Command::CalStart(procedure.unwrap_or_default()).into(),
        },
    ),
    CommandSpec::new("cal", "mark", "in a swing: record samples at this magnetic heading of the vehicle")
        .with_arguments(&[ArgumentSpec::new("HEADING", ArgumentKind::Heading(None))], |arguments| {
            Command::CalMark(arguments.number_argument(0).unwrap_or(f32::NAN)).into()
        }),
    CommandSpec::new("cal", "stop", "stop collecting, keep the samples").with_request(|_| Command::CalStop.into()),
    CommandSpec::new(
        "cal",
        "solve",
        "solve with the collected samples, by the best method they support or by a given one",
    )
    .with_arguments(&[ArgumentSpec::optional_argument("METHOD", ArgumentKind::Choice(nth_method_name))], |arguments| {
        Command::CalSolve(arguments.choice_argument(0, |index| METHODS.get(index).copied())).into()
    }),
    CommandSpec::new("cal", "advise", "show the weakest part of the last solve, and the manoeuvre that improves it")
        .with_request(|_| Command::CalAdvise.into()),
    CommandSpec::new("cal", "show", "show the active calibration").with_request(|_| Command::CalShow.into()),
    CommandSpec::new("cal", "clear", "delete the stored calibrations")
        .with_arguments(&[ArgumentSpec::new("all", ArgumentKind::Confirmation("all"))], |_| Command::CalClear.into()),
    CommandSpec::new("cal", "undo", "return to the previous calibration; again: to the newer one")
        .with_request(|_| Command::CalUndo.into()),
    CommandSpec::new("cal", "abort", "stop the collection or the solve, delete the samples")
        .with_request(|_| Command::CalAbort.into()),
    CommandSpec::new("autopilot", "", "the autopilot's parameters, by MAVLink"),
    CommandSpec::new("autopilot", "check", "compare its compass and its parameters with what the module needs")
        .with_request(|_| Command::Autopilot(AutopilotAction::Check).into()),
    CommandSpec::new("autopilot", "setup", "without yes: check; yes: write what differs, while disarmed")
        .with_arguments(&[ArgumentSpec::optional_argument("yes", ArgumentKind::Confirmation("yes"))], |arguments| {
            match arguments.0 {
                [ArgumentValue::Choice(_), _] => Command::Autopilot(AutopilotAction::Setup).into(),
                _ => Command::Autopilot(AutopilotAction::Check).into(),
            }
        }),
    CommandSpec::new("autopilot", "undo", "write the numbers back that setup has replaced, while disarmed")
        .with_request(|_| Command::Autopilot(AutopilotAction::Undo).into()),
    CommandSpec::new("autopilot", "restart", "restart the autopilot, while disarmed")
        .with_request(|_| Command::Autopilot(AutopilotAction::Restart).into()),
    CommandSpec::new("reboot", "", "restart the module").with_request(|_| Command::Restart.into()),
    CommandSpec::new("set", "", "settings"),
    CommandSpec::new(
        "set",
        "align",
        "magnetic heading of the vehicle now: removes a constant error; none: as calibrated; yes: of any size",
    )
    .with_arguments(
        &[
            ArgumentSpec::new("HEADING", ArgumentKind::Heading(Some("none"))),
            ArgumentSpec::optional_argument("yes", ArgumentKind::Confirmation("yes")),
        ],
        |arguments| match arguments.0 {
            [ArgumentValue::Number(heading_deg), ArgumentValue::Choice(_)] => {
                Command::AlignConfirmed(heading_deg).into()
            }
            _ => Command::Align(arguments.number_argument(0)).into(),
        },
    ),
];

/// Methods that a person may ask for; the others belong to a procedure.
const METHODS: [Method; 3] = [Method::MaximumLikelihood, Method::FourEllipse, Method::Level];

fn nth_method_name(index: usize) -> Option<&'static str> {
    METHODS.get(index).map(|method| method.method_name())
}

fn nth_procedure(index: usize) -> Option<Procedure> {
    Procedure::ALL_PROCEDURES.get(index).copied()
}

fn nth_procedure_name(index: usize) -> Option<&'static str> {
    nth_procedure(index).map(Procedure::procedure_name)
}

/// Index of the choice `again`, which follows the procedures: the last procedure with an empty collection.
const AGAIN_INDEX: usize = Procedure::ALL_PROCEDURES.len();

fn nth_procedure_or_again(index: usize) -> Option<&'static str> {
    if index == AGAIN_INDEX { Some("again") } else { nth_procedure_name(index) }
}

/// Request parsed from a console line.
#[derive(Clone, Copy, Debug)]
pub enum Request {
    /// List the commands, or explain one.
    Help(Option<ConsoleCommand>),
    /// Show the firmware's version.
    Version,
    /// Command for the state machine.
    Command(Command),
}

impl From<Command> for Request {
    fn from(command: Command) -> Self {
        Self::Command(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Commands follow the row of their first word; no two are equal; a row without a request has second words.
    #[test]
    fn the_command_table_is_grouped_and_has_no_duplicates() {
        let commands: Vec<ConsoleCommand> = all_commands().collect();
        for (i, row) in commands.iter().enumerate() {
            let [first, second] = row.words();
            assert!(!commands[..i].iter().any(|other| other.words() == row.words()), "{first} {second} is there twice");
            assert!(second.is_empty() || commands[i - 1].words()[0] == first, "{first} {second} stands alone");
            assert_eq!(
                row.is_group(),
                second.is_empty() && commands.iter().filter(|row| row.words()[0] == first).count() > 1
            );
            assert!(row.arguments().count() <= 2);
        }
    }
}
