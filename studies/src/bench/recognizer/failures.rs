//! Remaining failures: whether the likelihood or the search causes them, and pictures.

use spindoe::geometry::{angle_between, rotation_angle};
use spindoe::plot::{RecognitionView, recognition_views};
use spindoe::recognize::robust::{RobustRecognizer, RobustWorkspace};
use spindoe::recognize::{Identification, Recognizer};
use spindoe::validate::ORIENTATION_FAILURE_RAD;
use spindoe::view::{ProtocolName, Trial, ViewModel};
use spindoe_studies::row;
use spindoe_studies::table::Table;

use super::{Bench, degrees};

/// Failing views drawn for each protocol.
const DRAWN: usize = 3;
/// Maximum number of trials that are searched for failures.
const MAX_TRIALS: u64 = 1_000_000;
/// Nats by which the truth must be better for the failure to count as the search's.
const CLEAR: f64 = 0.01;

/// A failing view with its cause.
struct Failure {
    sentence: String,
    view: RecognitionView,
}

/// Causes of the failures.
#[derive(Default)]
struct Blame {
    /// The answer explains the dots better than the truth.
    likelihood: usize,
    /// The truth is better, and was not found.
    search: usize,
    /// Correct pose, single dots wrong.
    dots: usize,
}

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("### What fails still");
    let table = Table::new([
        "protocol",
        "trials",
        "wrong pose, answer explains the dots better",
        "wrong pose, search missed the truth",
        "correct pose, single dots wrong",
    ]);
    let [paper, sparse, clutter, image] = ProtocolName::ALL;
    let all = [
        ("paper", "paper", paper.view()),
        ("paper_8_deg", "paper", degrees(paper, 8.0)),
        ("sparse", "sparse", sparse.view()),
        ("clutter", "clutter", clutter.view()),
        ("image", "image", image.view()),
    ];
    let mut sentences = String::new();
    for (name, protocol, view) in all {
        let (failures, blame, trials) = examine(bench, view)?;
        let sigma = view.noise.sigma_rad().to_degrees();
        let title = format!("{protocol}, {sigma:.1} deg");
        row!(table; &title, trials, blame.likelihood, blame.search, blame.dots);
        for (k, failure) in failures.iter().enumerate() {
            let head = if k == 0 {
                format!("\n#### {title}\n\n")
            } else {
                String::new()
            };
            sentences += &format!("{head}{}. {}\n", k + 1, failure.sentence);
        }
        let views: Vec<_> = failures.into_iter().map(|f| f.view).collect();
        if !views.is_empty() {
            let path = bench.out.join(format!("failures_{name}.png"));
            let title = format!("Failing views: {title}");
            recognition_views(&path, &title, bench.pattern(), &views)?;
        }
    }
    print!("{sentences}");
    Ok(())
}

/// Evaluates the trials, and more until enough views have failed; wrong poses are drawn first.
fn examine(bench: &Bench, view: ViewModel) -> spindoe::Result<(Vec<Failure>, Blame, u64)> {
    let robust = bench.robust(view)?;
    let mut generator = bench.trials(view).generator();
    let (mut trial, mut ws) = (Trial::default(), robust.workspace());
    let (mut poses, mut dots) = (Vec::new(), Vec::new());
    let mut blame = Blame::default();
    let mut index = 0;
    while index < bench.samples || (poses.len() + dots.len() < DRAWN && index < MAX_TRIALS) {
        generator.generate(index, &mut trial);
        index += 1;
        if trial.dots.len() < view.min_dots.max(robust.min_dots()) {
            continue;
        }
        let outcome = robust.identify(&trial.dots, &mut ws);
        let done = outcome.is_ok();
        let answer = outcome.unwrap_or_default();
        if done && answer.assignment == trial.truth {
            continue;
        }
        let error = rotation_angle(&answer.rotation, &trial.rotation);
        let sentence = if done && error < ORIENTATION_FAILURE_RAD {
            blame.dots += 1;
            about_dots(bench, &trial, &answer)
        } else {
            about_pose(&robust, &trial, &answer, &mut ws, &mut blame)
        };
        let failure = Failure {
            view: RecognitionView {
                caption: format!("Trial {}: {sentence}", index - 1),
                visibility_limit: view.visibility_limit,
                observed: trial.dots.iter().map(|d| d.direction).collect(),
                truth: trial.rotation,
                answer: done.then_some(answer.rotation),
            },
            sentence,
        };
        let of_pose = !done || error >= ORIENTATION_FAILURE_RAD;
        let list = if of_pose { &mut poses } else { &mut dots };
        if list.len() < DRAWN {
            list.push(failure);
        }
    }
    // Two of the graver kind and one of the lighter, where both exist.
    poses.truncate(if dots.is_empty() { DRAWN } else { DRAWN - 1 });
    poses.extend(dots);
    poses.truncate(DRAWN);
    Ok((poses, blame, index))
}

fn about_pose(
    robust: &RobustRecognizer,
    trial: &Trial,
    answer: &Identification,
    ws: &mut RobustWorkspace,
    blame: &mut Blame,
) -> String {
    let mut evidence = |rotation| {
        let found = robust.explain_near(&trial.dots, rotation, ws);
        found.map_or(f64::NEG_INFINITY, |f| f.ln_evidence)
    };
    let worse = evidence(&answer.rotation) - evidence(&trial.rotation);
    let real = trial.truth.iter().flatten().count();
    let at_fault = if worse > -CLEAR {
        blame.likelihood += 1;
        format!(
            "{:.1} nats better than the truth does: no recognizer based on the likelihood can correct that",
            worse.max(0.0)
        )
    } else {
        blame.search += 1;
        format!(
            "{:.1} nats worse than the truth does: the search missed it",
            -worse
        )
    };
    format!(
        "{real} real and {}; a pose {:.0} deg off explains {} of them {at_fault} (confidence {:.2}).",
        match trial.truth.len() - real {
            1 => "1 false dot".to_owned(),
            n => format!("{n} false dots"),
        },
        rotation_angle(&answer.rotation, &trial.rotation).to_degrees(),
        answer.matched(),
        answer.dots_confidence
    )
}

fn about_dots(bench: &Bench, trial: &Trial, answer: &Identification) -> String {
    let mut parts = Vec::new();
    let pairs = trial.truth.iter().zip(&answer.assignment);
    for ((truth, answered), dot) in pairs.zip(&trial.dots) {
        let off = |j: &u16| {
            let place = trial.rotation * bench.pattern().dots()[usize::from(*j)];
            angle_between(&place, &dot.direction).to_degrees()
        };
        match (truth, answered) {
            (a, b) if a == b => {}
            (Some(j), None) => {
                parts.push(format!(
                    "dot {j}, {:.1} deg off its place, is left out",
                    off(j)
                ));
            }
            (None, Some(j)) => parts.push(format!(
                "a false dot {:.1} deg from the place of dot {j} is taken for it",
                off(j)
            )),
            (Some(j), Some(k)) => parts.push(format!(
                "dot {j}, {:.1} deg off its place, is taken for {k}, {:.1} deg away",
                off(j),
                off(k)
            )),
            (None, None) => {}
        }
    }
    format!(
        "correct pose, but {} (confidence {:.2}).",
        parts.join(", and "),
        answer.dots_confidence
    )
}
