//! Arguments of the program, made from its own options.
//!
//! They are read as the program reads them, and checked as far as it checks them before any work.
//! Nothing is run.

use crate::source::Source;
use clap::{Command, CommandFactory};
use std::cell::RefCell;

/// Values that options trip over, whatever they take.
const VALUES: [&str; 44] = [
    "",
    "0",
    "1",
    "-1",
    "2",
    "64",
    "65",
    "255",
    "256",
    "1367",
    "1368",
    "4294967295",
    "4294967296",
    "18446744073709551616",
    "1e3",
    "nan",
    "inf",
    "-inf",
    "0.5",
    "-0",
    "1e39",
    "1e-50",
    "100",
    "100%",
    "99.9",
    "k",
    "1k",
    "17179869184G",
    "1.5M",
    "64x36",
    "0x0",
    "99999x99999",
    "x",
    "1,2,3",
    "1,2",
    "1,2,3,4,5,6",
    "nan,0,0",
    "sky",
    "auto",
    "cpu",
    "best",
    "builtin:cornell",
    "\u{202e}\u{0}",
    "a\nb",
];

thread_local! {
    /// Made once: it takes longer than reading arguments does.
    static COMMAND: RefCell<Command> = RefCell::new({
        let mut command = splitplane_cli::Cli::command();
        command.build();
        command
    });
    static GRAMMAR: Vec<Verb> = grammar();
}

/// A verb and its options.
struct Verb {
    /// `None` for what stands without one.
    name: Option<String>,
    options: Vec<Option_>,
}

struct Option_ {
    /// `--name`, or nothing for what stands by itself.
    flag: Option<String>,
    takes_value: bool,
    /// Values that it names.
    possible: Vec<String>,
}

/// What the program itself says of its options.
fn grammar() -> Vec<Verb> {
    let verb = |command: &Command, name: Option<String>| Verb {
        name,
        options: command
            .get_arguments()
            .map(|argument| Option_ {
                flag: argument.get_long().map(|long| format!("--{long}")),
                takes_value: argument.get_action().takes_values(),
                possible: argument
                    .get_possible_values()
                    .iter()
                    .map(|value| value.get_name().to_owned())
                    .collect(),
            })
            .collect(),
    };
    COMMAND.with_borrow(|command| {
        let verbs = command.get_subcommands().map(|sub| verb(sub, Some(sub.get_name().to_owned())));
        std::iter::once(verb(command, None)).chain(verbs).collect()
    })
}

/// Bytes as arguments.
pub fn run(data: &[u8]) {
    let mut source = Source::new(data);
    let arguments = GRAMMAR.with(|verbs| arguments(&mut source, verbs));
    let read = COMMAND.with_borrow_mut(|command| command.try_get_matches_from_mut(&arguments));
    let matches = match read {
        Ok(matches) => matches,
        Err(error) => {
            use clap::error::ErrorKind;
            let message = error.render().to_string();
            assert!(!message.trim().is_empty());
            let wanted = matches!(
                error.kind(),
                ErrorKind::DisplayHelp
                    | ErrorKind::DisplayVersion
                    | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
            );
            assert_eq!(error.exit_code(), if wanted { 0 } else { 2 }, "{message}");
            return;
        }
    };
    let cli = <splitplane_cli::Cli as clap::FromArgMatches>::from_arg_matches(&matches)
        .expect("as they were read");
    if let Err(failure) = cli.check() {
        crate::check_message(failure.message(), "");
        assert_eq!(failure.number(), 2, "{}", failure.message());
    }
}

fn arguments(source: &mut Source<'_>, verbs: &[Verb]) -> Vec<String> {
    let verb = &verbs[source.below(verbs.len())];
    let mut arguments = vec!["splitplane".to_owned()];
    arguments.extend(verb.name.clone());
    if !source.once_in(8) {
        // Most verbs want a scene; `paper` takes its own by an option.
        arguments.push("builtin:cornell".to_owned());
    }
    for _ in 0..source.below(6) {
        let from = if source.once_in(16) { &verbs[source.below(verbs.len())] } else { verb };
        let Some(option) = from.options.get(source.below(from.options.len().max(1))) else {
            continue;
        };
        let value = value(source, &option.possible);
        match &option.flag {
            None => arguments.push(value),
            Some(flag) if option.takes_value != source.once_in(32) => {
                if source.once_in(2) {
                    arguments.push(format!("{flag}={value}"));
                } else {
                    arguments.extend([flag.clone(), value]);
                }
            }
            Some(flag) => arguments.push(flag.clone()),
        }
    }
    if source.once_in(32) {
        arguments
            .push(source.pick(&["--", "-", "---", "-q", "-qqq", "-o", "--no", "--ray"]).to_owned());
    }
    arguments
}

fn value(source: &mut Source<'_>, possible: &[String]) -> String {
    match source.below(8) {
        0..3 if !possible.is_empty() => possible[source.below(possible.len())].clone(),
        0..6 => source.pick(&VALUES).to_owned(),
        6 => format!("{}", source.count()),
        _ => String::from_utf8_lossy(source.bytes(24)).into_owned(),
    }
}
