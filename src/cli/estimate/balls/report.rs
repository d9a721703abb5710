//! What is reported of the balls of frames.

use serde_json::{Value, json};

use crate::cli::estimate::format::ForeignFormat;
#[cfg(feature = "plot")]
use crate::cli::estimate::overlay;
use crate::cli::estimate::verdict::VerdictWords;
use crate::cli::estimate::written::{
    ClipRows, FoundSpin, WrittenRow, add_spin, ball_json, circle_json, found_spin, own_row,
    say_times, spin_words,
};
use crate::cli::estimate::{Asked, Picture};
use crate::cli::spin_summary;
use crate::clip::orientations;
use crate::clip::{
    BallEstimate, Batch, BatchFrame, NamedFrame, SequenceEvidence, SequenceOutcome, Strobe,
    StrobeHypothesis,
};
use crate::error::Result;
use crate::files::csv::shown;
use crate::geometry::CameraFrame;
#[cfg(feature = "plot")]
use crate::plot::OverlayFrame;
use crate::spin::estimate::MotionModel;
#[cfg(feature = "plot")]
use crate::spin::orientations::Orientations;
use crate::spin::orientations::{BallColumns, OrientationRow};

#[cfg(feature = "plot")]
use crate::vision::Estimator;

/// Other hypotheses of an exposure that are named in words.
const MAX_NAMED: usize = 3;

impl WrittenRow {
    /// That of a ball with its number, and its table where there are several.
    pub fn of_ball(
        asked: &Asked,
        shown_in: CameraFrame,
        mut row: OrientationRow,
        number: Option<usize>,
        ball: &BallEstimate,
    ) -> Self {
        let mut json = ball_json(&row, shown_in, &ball.frame);
        json["ball"] = json!(number);
        json["circle"] = json!(ball.circle().as_ref().map(circle_json));
        row.ball = number;
        if asked.table.len() > 1 {
            let table = table_name(asked, ball.table);
            json["table"] = table.as_str().into();
            json["table_probability"] = ball.tables.get(ball.table).copied().into();
            row.table = row.orientation.map(|_| table);
        }
        let note = ball.frame.outcome.as_ref().err().map(ToString::to_string);
        Self { row, json, note }
    }
}

/// The rows of an exposure's images, of a frame with this name and time: in order of time, then what the likeliest hypothesis leaves out.
pub(in crate::cli) fn strobe_rows(
    asked: &Asked,
    shown_in: CameraFrame,
    (name, start_s): (&str, f64),
    balls: &[BallEstimate],
    found: &[StrobeHypothesis],
    numbers: &[Option<usize>],
) -> Vec<WrittenRow> {
    let lit = found.first().map_or(&[][..], |h| &h.lit[..]);
    let mut rows = Vec::with_capacity(balls.len());
    for (at, (image, flash)) in lit.iter().enumerate() {
        let mut row = found[0].orientations.rows[at].clone();
        row.frame = name.to_owned();
        row.time_s += start_s;
        row.flash = Some(*flash);
        rows.push(WrittenRow::of_ball(
            asked,
            shown_in,
            row,
            Some(at),
            &balls[*image],
        ));
    }
    let is_left = |k: &usize| lit.iter().all(|(image, _)| image != k);
    for k in (0..balls.len()).filter(is_left) {
        let named = NamedFrame {
            name,
            time_s: None,
            estimate: &balls[k].frame,
        };
        let row = own_row(named, shown_in);
        rows.push(WrittenRow::of_ball(
            asked, shown_in, row, numbers[k], &balls[k],
        ));
    }
    rows
}

/// A ball of a sequence.
struct Followed {
    table: usize,
    table_probability: f64,
    frames: usize,
    identified: usize,
    spin: FoundSpin,
}

/// A ball of all frames.
#[cfg(feature = "plot")]
pub(in crate::cli::estimate) struct BallRows<'a> {
    pub number: usize,
    pub table: usize,
    /// The frames that show it, by their places among all.
    pub frames: Vec<(usize, NamedFrame<'a>)>,
    pub orientations: Orientations,
    /// Where the frames have times.
    pub spin: Option<&'a FoundSpin>,
}

/// What is reported.
pub(in crate::cli::estimate) struct BallsReport<'a> {
    /// For each frame its balls in the order of their numbers.
    rows: ClipRows<'a, Picture>,
    /// For each frame the numbers of its balls.
    numbers: Vec<Vec<Option<usize>>>,
    /// The balls of a sequence by number.
    followed: Vec<Followed>,
    /// For each frame the hypotheses of its flashes.
    strobes: Vec<(Vec<StrobeHypothesis>, Value)>,
}

impl<'a> BallsReport<'a> {
    pub fn new(
        asked: &'a Asked,
        batch: &'a Batch<Picture>,
        strobe: Option<&Strobe>,
        motion: MotionModel,
    ) -> Result<Self> {
        let mut this = Self {
            rows: ClipRows {
                asked,
                axes: asked.frame()?,
                batch,
                frames: Vec::new(),
                columns: BallColumns {
                    ball: true,
                    table: asked.table.len() > 1,
                    flash: strobe.is_some(),
                    cameras: false,
                },
            },
            numbers: Vec::new(),
            followed: Vec::new(),
            strobes: Vec::new(),
        };
        match (&batch.sequence, strobe) {
            (_, Some(strobe)) => this.read_strobes(strobe),
            (SequenceOutcome::Numbered(numbered), None) => {
                this.numbers.clone_from(&numbered.numbers);
                this.add_rows(Some(motion));
                for (number, (table, share)) in numbered.tables.iter().enumerate() {
                    this.followed[number].table = *table;
                    this.followed[number].table_probability = *share;
                }
            }
            _ => {
                let from_left = |f: &BatchFrame<_>| (0..f.balls.len()).map(Some).collect();
                this.numbers = batch.frames.iter().map(from_left).collect();
                this.add_rows(None);
            }
        }
        Ok(this)
    }

    /// The rows of numbered balls; of a sequence, whose balls move by `motion`, each ball's orientations are in one frame.
    fn add_rows(&mut self, motion: Option<MotionModel>) {
        let ClipRows {
            asked, axes, batch, ..
        } = self.rows;
        let (frames, numbers) = (&batch.frames, &self.numbers);
        let mut rows: Vec<Vec<WrittenRow>> = frames.iter().map(|_| Vec::new()).collect();
        let all = numbers.iter().flatten().flatten();
        let count = all.max().map_or(0, |n| n + 1);
        for number in (0..count).map(Some).chain([None]) {
            let mut places = Vec::new();
            for (k, (frame, numbers)) in frames.iter().zip(numbers).enumerate() {
                let of_number = frame
                    .balls
                    .iter()
                    .zip(numbers)
                    .filter(|(_, n)| **n == number);
                places.extend(of_number.map(|(ball, _)| (k, ball)));
            }
            let named = places.iter().map(|(k, ball)| NamedFrame {
                name: &frames[*k].name,
                time_s: frames[*k].time_s,
                estimate: &ball.frame,
            });
            let named: Vec<NamedFrame<'_>> = named.collect();
            let file = orientations(&named, axes, motion.is_some() && number.is_some());
            if let (Some(motion), Some(_)) = (motion, number) {
                let (timed, nothing) = ((&file, &batch.times), SequenceEvidence::default());
                self.followed.push(Followed {
                    table: 0,
                    table_probability: 1.0,
                    frames: file.rows.len(),
                    identified: file.rows.iter().filter(|r| r.orientation.is_some()).count(),
                    spin: found_spin(asked, timed, motion, &nothing),
                });
            }
            for ((k, ball), row) in places.into_iter().zip(file.rows) {
                rows[k].push(WrittenRow::of_ball(asked, axes, row, number, ball));
            }
        }
        self.rows.frames = rows;
    }

    /// The rows of strobed balls: in order of time, then what the likeliest hypothesis leaves out; the numbers of the balls.
    fn read_strobes(&mut self, strobe: &Strobe) {
        let ClipRows {
            asked, axes, batch, ..
        } = self.rows;
        for frame in &batch.frames {
            let balls = &frame.balls;
            let found = strobe.read(balls, axes);
            let numbers = strobe_numbers(balls, &found);
            let start_s = frame.time_s.unwrap_or(0.0);
            let named = (frame.name.as_str(), start_s);
            let rows = strobe_rows(asked, axes, named, balls, &found, &numbers);
            self.rows.frames.push(rows);
            let json = strobe_json(asked, strobe, axes, &found, &numbers);
            self.strobes.push((found, json));
            self.numbers.push(numbers);
        }
    }

    /// The frame of orientations and spins.
    #[cfg(feature = "plot")]
    pub fn axes(&self) -> CameraFrame {
        self.rows.axes
    }

    /// Each ball with the frames that show it.
    #[cfg(feature = "plot")]
    pub fn by_number(&self) -> Vec<BallRows<'_>> {
        let ClipRows { axes, batch, .. } = self.rows;
        let all = self.numbers.iter().flatten().flatten();
        let count = all.max().map_or(0, |n| n + 1);
        let of_number = |number: usize| {
            let mut ball = BallRows {
                number,
                table: self.followed.get(number).map_or(0, |f| f.table),
                frames: Vec::new(),
                orientations: Orientations {
                    camera_frame: Some(axes),
                    ..Orientations::default()
                },
                spin: self.followed.get(number).map(|f| &f.spin),
            };
            for (k, (frame, numbers)) in batch.frames.iter().zip(&self.numbers).enumerate() {
                let at = numbers.iter().position(|n| *n == Some(number));
                let row = self.rows.frames[k].iter();
                let row = row.map(|r| &r.row).find(|row| row.ball == Some(number));
                if let (Some(at), Some(row)) = (at, row) {
                    let named = NamedFrame {
                        name: &frame.name,
                        time_s: frame.time_s,
                        estimate: &frame.balls[at].frame,
                    };
                    ball.frames.push((k, named));
                    ball.orientations.rows.push(row.clone());
                }
            }
            ball
        };
        (0..count).map(of_number).collect()
    }

    /// A frame with its balls drawn on it.
    #[cfg(feature = "plot")]
    pub fn drawn(&self, k: usize, estimators: &[Estimator]) -> OverlayFrame {
        let frame = &self.rows.batch.frames[k];
        let balls = frame.balls.iter().zip(&self.numbers[k]);
        let drawn = balls
            .clone()
            .map(|(ball, number)| (&ball.frame, &estimators[ball.table], *number));
        let drawn: Vec<overlay::DrawnBall<'_>> = drawn.collect();
        let words = match (&frame.unreadable, self.strobes.get(k)) {
            (Some(why), _) => why.clone(),
            (None, Some((found, _))) => self.strobe_lines(k, found).swap_remove(0),
            (None, None) => {
                let posed = balls.filter(|(ball, _)| ball.frame.pose().is_some());
                format!("{} of {} balls identified", posed.count(), drawn.len())
            }
        };
        overlay::drawn(&frame.name, words, &frame.kept, &drawn)
    }

    /// Why nothing is answered, where no ball is.
    pub fn no_answer(&self) -> Option<String> {
        let frames = self.rows.frames.len();
        let ClipRows { batch, asked, .. } = &self.rows;
        let verdict = VerdictWords::new(&batch.judgment, &asked.table);
        let none = || format!("no ball of {frames} frames is identified");
        if self.rows.identified() == 0 {
            return Some(verdict.rejection().unwrap_or_else(none));
        }
        let is_without = asked.is_as(ForeignFormat::Gspro) && self.shots().is_empty();
        is_without.then(|| format!("no spin, and so no shot, in {frames} exposures"))
    }

    /// The rows as they are asked for: orientations, or a line for each shot.
    ///
    /// # Errors
    /// Those of [`ClipRows::text`].
    pub fn text(&self) -> Result<String> {
        match self.rows.asked.is_as(ForeignFormat::Gspro) {
            true => Ok(self.shots()),
            false => self.rows.text(),
        }
    }

    /// A line for each shot.
    fn shots(&self) -> String {
        let shot = |(k, strobe): (u64, &(Vec<_>, _))| shot_line(k, &strobe.0, self.rows.axes);
        let shots = (1..).zip(&self.strobes).filter_map(shot);
        shots.map(|line| line + "\n").collect()
    }

    pub fn to_json(&self) -> Value {
        let balls = self.followed.iter().enumerate().map(|(number, ball)| {
            let mut json = json!({
                "ball": number,
                "table": table_name(self.rows.asked, ball.table),
                "table_probability": ball.table_probability,
                "frames": ball.frames,
                "identified": ball.identified,
            });
            add_spin(Some(&ball.spin), self.rows.axes, &mut json);
            json
        });
        let mut json = self.rows.to_json();
        for (k, (_, strobe)) in self.strobes.iter().enumerate() {
            json["frames"][k]["strobe"] = strobe.clone();
        }
        json["detector"] = json!(self.rows.asked.source.detector);
        json["balls"] = balls.collect();
        json
    }

    /// Summarizes the outcome on standard error.
    pub fn say(&self) {
        self.rows.say_inputs();
        for (k, frame) in self.rows.batch.frames.iter().enumerate() {
            self.rows.say_frame(k);
            let strobe = self.strobes.get(k).filter(|_| frame.unreadable.is_none());
            for line in strobe.map_or(Vec::new(), |(found, _)| self.strobe_lines(k, found)) {
                errln!("{}: {line}", shown(&frame.name));
            }
        }
        let count: usize = self.rows.frames.iter().map(Vec::len).sum();
        errln!(
            "{} of {count} balls in {} frames identified",
            self.rows.identified(),
            self.rows.frames.len()
        );
        // The spin of an exposure needs no times of frames.
        if self.strobes.is_empty() {
            say_times(self.rows.batch);
        }
        for (number, ball) in self.followed.iter().enumerate() {
            let table = match self.rows.asked.table.len() {
                1 => String::new(),
                _ => format!(
                    " is {} ({:.4}),",
                    table_name(self.rows.asked, ball.table),
                    ball.table_probability
                ),
            };
            let spin = spin_words(Some(&ball.spin), self.rows.axes).unwrap_or_default();
            errln!(
                "ball {number}:{table} {} of {} frames identified; spin: {spin}",
                ball.identified,
                ball.frames
            );
        }
    }

    fn strobe_lines(&self, k: usize, found: &[StrobeHypothesis]) -> Vec<String> {
        let Some((first, others)) = found.split_first() else {
            return vec!["fewer than two images of the ball: no spin".into()];
        };
        let mut lines = vec![self.hypothesis_words(first)];
        let lit = first
            .lit
            .first()
            .map(|(image, _)| &self.rows.batch.frames[k].balls[*image]);
        if let Some(ball) = lit.filter(|_| self.rows.asked.table.len() > 1) {
            let name = table_name(self.rows.asked, ball.table);
            let share = ball.tables.get(ball.table).copied().unwrap_or(f64::NAN);
            lines[0] = format!("ball of {name} ({share:.4}), {}", lines[0]);
        }
        if !others.is_empty() {
            lines[0].push_str(&format!(", probability {:.2}", first.probability));
        }
        for other in others.iter().take(MAX_NAMED) {
            let words = self.hypothesis_words(other);
            lines.push(format!("  or, {:.2}: {words}", other.probability));
        }
        let aliases = first.spin.as_ref().map_or(0, |(_, others)| others.len());
        if aliases > 0 {
            lines.push(format!(
                "  {aliases} faster spins explain the images as well: --json lists them"
            ));
        }
        lines
    }

    fn hypothesis_words(&self, hypothesis: &StrobeHypothesis) -> String {
        let images = hypothesis.lit.len();
        let flashes = images + hypothesis.missed.len();
        let seen = match hypothesis.missed.as_slice() {
            [] => format!("{images} of {flashes} flashes"),
            missed => {
                let missed: Vec<String> = missed.iter().map(usize::to_string).collect();
                format!(
                    "{images} of {flashes} flashes, without {}",
                    missed.join(", ")
                )
            }
        };
        let flight = hypothesis.flight;
        let golf = hypothesis.golf(self.rows.axes);
        let spin = match (&hypothesis.spin, golf.filter(|_| self.rows.asked.is_golf())) {
            (_, Some(golf)) => {
                let [back, side] = golf.std_rpm.unwrap_or([f64::NAN; 2]);
                format!(
                    "backspin {:.0} +- {back:.0} rpm, sidespin {:.0} +- {side:.0} rpm, tilt {:.1} deg, total {:.0} rpm, {}",
                    golf.backspin_rpm,
                    golf.sidespin_rpm,
                    golf.tilt_deg,
                    golf.total_rpm,
                    golf.spin_type.as_str()
                )
            }
            (Ok((fit, _)), None) => {
                let [x, y, z]: [f64; 3] = fit.motion.spin.into();
                let rps = fit.motion.rps();
                format!("spin {rps:.3} rps, [{x:.3}, {y:.3}, {z:.3}] rad/s")
            }
            (Err(rejection), None) => rejection.to_string(),
        };
        format!("flight {flight}, {seen}: {spin}")
    }
}

/// The shot of an exposure with this number, by its likeliest hypothesis.
pub(in crate::cli) fn shot_line(
    number: u64,
    found: &[StrobeHypothesis],
    shown_in: CameraFrame,
) -> Option<String> {
    let shot = found.first()?.shot(number, shown_in)?;
    Some(json!(shot).to_string())
}

fn table_name(asked: &Asked, table: usize) -> String {
    let path = asked.table.get(table);
    path.map_or(String::new(), |path| path.display().to_string())
}

/// The numbers of an exposure's images: those of the likeliest hypothesis in order of time, then the others.
pub(in crate::cli) fn strobe_numbers(
    balls: &[BallEstimate],
    found: &[StrobeHypothesis],
) -> Vec<Option<usize>> {
    let lit = found.first().map_or(&[][..], |h| &h.lit[..]);
    let mut numbers = vec![None; balls.len()];
    for (at, (image, _)) in lit.iter().enumerate() {
        numbers[*image] = Some(at);
    }
    let open = numbers.iter_mut().zip(balls);
    let open = open.filter(|(number, ball)| number.is_none() && ball.circle().is_some());
    for (number, (place, _)) in (lit.len()..).zip(open) {
        *place = Some(number);
    }
    numbers
}

/// The hypotheses of an exposure; `numbers` are those of its images.
pub(in crate::cli) fn strobe_json(
    asked: &Asked,
    strobe: &Strobe,
    shown_in: CameraFrame,
    found: &[StrobeHypothesis],
    numbers: &[Option<usize>],
) -> Value {
    let hypotheses = found.iter().map(|h| {
        let lit = h.lit.iter().map(|(image, flash)| {
            let (ball, time_s) = (numbers[*image], strobe.times_s()[*flash]);
            json!({ "ball": ball, "flash": flash, "time_s": time_s })
        });
        let mut json = json!({
            "probability": h.probability,
            "flight": h.flight.as_str(),
            "images": lit.collect::<Vec<_>>(),
            "missed": h.missed,
            "velocity_px_s": h.velocity_px_s,
        });
        match &h.spin {
            Ok((fit, others)) => {
                json["spin"] = spin_summary::fit_json(fit, shown_in);
                let others = others.iter().map(|a| {
                    json!({
                        "spin_rad_s": [a.spin.x, a.spin.y, a.spin.z],
                        "log_likelihood_ratio": a.log_likelihood_ratio,
                    })
                });
                json["spin"]["alternatives"] = others.collect();
                if asked.is_golf() {
                    json["golf"] = json!(h.golf(shown_in));
                }
            }
            Err(rejection) => json["spin_refusal"] = rejection.to_string().into(),
        }
        json
    });
    json!({ "hypotheses": hypotheses.collect::<Vec<_>>() })
}
