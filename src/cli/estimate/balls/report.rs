//! What is reported of the balls of frames.

use serde_json::{Value, json};

#[cfg(feature = "plot")]
use crate::cli::estimate::overlay;
use crate::cli::estimate::{Arguments, Picture, output};
use crate::cli::{inputs, spin_summary};
use crate::clip::ball_tracks::number_balls;
use crate::clip::balls::BallEstimate;
use crate::clip::balls_batch::BallsBatch;
use crate::clip::orientations;
use crate::clip::orientations::NamedFrame;
use crate::clip::strobe::{Strobe, StrobeHypothesis};
use crate::error::Result;
use crate::files::csv::shown;
use crate::geometry::CameraFrame;
#[cfg(feature = "plot")]
use crate::plot::OverlayFrame;
use crate::spin::SpinRejection;
use crate::spin::orientations::{OrientationRow, OrientationWriter};
use crate::spin::robust::SpinConfig;
use crate::spin::summary::SpinSummary;

#[cfg(feature = "plot")]
use crate::clip::batch::TimeSource;
#[cfg(feature = "plot")]
use crate::vision::Estimator;

/// Other hypotheses of an exposure that are named in words.
const MAX_NAMED: usize = 3;

/// A row of the output, with what stands in its further columns.
struct Row {
    row: OrientationRow,
    ball: Option<usize>,
    table: Option<usize>,
    flash: Option<usize>,
    json: Value,
}

/// A ball of a sequence.
struct Followed {
    table: usize,
    table_probability: f64,
    frames: usize,
    identified: usize,
    /// Where the frames have times.
    spin: Option<std::result::Result<SpinSummary, SpinRejection>>,
}

/// What is reported.
pub(super) struct Report<'a> {
    arguments: &'a Arguments,
    shown_in: CameraFrame,
    batch: &'a BallsBatch<Picture>,
    /// For each frame its balls, and their numbers.
    balls: Vec<Vec<BallEstimate>>,
    numbers: Vec<Vec<Option<usize>>>,
    /// For each frame its balls in the order of their numbers.
    rows: Vec<Vec<Row>>,
    /// The balls of a sequence by number.
    followed: Vec<Followed>,
    /// For each frame the hypotheses of its flashes.
    strobes: Vec<(Vec<StrobeHypothesis>, Value)>,
}

impl<'a> Report<'a> {
    pub fn new(
        arguments: &'a Arguments,
        batch: &'a mut BallsBatch<Picture>,
        strobe: Option<&Strobe>,
    ) -> Result<Self> {
        let shown_in = arguments.frame()?;
        let times_s = batch
            .times_s()
            .filter(|_| strobe.is_none() && !arguments.no_sequence);
        let mut balls: Vec<Vec<BallEstimate>> = Vec::new();
        for frame in &mut batch.frames {
            sort_from_left(&mut frame.balls);
            balls.push(std::mem::take(&mut frame.balls));
        }
        let spin = SpinConfig {
            max_rps: arguments.max_spin_rps(),
            times: batch.times.origin(),
            ..SpinConfig::default()
        };
        let numbered = times_s
            .as_ref()
            .map(|times_s| number_balls(spin, times_s, &mut balls));
        let mut this = Self {
            arguments,
            shown_in,
            batch,
            balls: Vec::new(),
            numbers: Vec::new(),
            rows: Vec::new(),
            followed: Vec::new(),
            strobes: Vec::new(),
        };
        this.numbers = match (numbered, strobe) {
            (_, Some(strobe)) => this.read_strobes(&balls, strobe),
            (None, None) => {
                let from_left = |balls: &Vec<BallEstimate>| (0..balls.len()).map(Some).collect();
                let numbers: Vec<_> = balls.iter().map(from_left).collect();
                this.add_rows(&balls, &numbers, None);
                numbers
            }
            (Some(numbered), None) => {
                this.add_rows(&balls, &numbered.numbers, Some(&spin));
                for (number, (table, share)) in numbered.tables.iter().enumerate() {
                    this.followed[number].table = *table;
                    this.followed[number].table_probability = *share;
                }
                numbered.numbers
            }
        };
        this.balls = balls;
        Ok(this)
    }

    /// The rows of numbered balls; of a sequence, whose spins are by `spin`, each ball's orientations are in one frame.
    fn add_rows(
        &mut self,
        balls: &[Vec<BallEstimate>],
        numbers: &[Vec<Option<usize>>],
        spin: Option<&SpinConfig>,
    ) {
        let frames = &self.batch.frames;
        let mut rows: Vec<Vec<Row>> = balls.iter().map(|_| Vec::new()).collect();
        let all = numbers.iter().flatten().flatten();
        let count = all.max().map_or(0, |n| n + 1);
        for number in (0..count).map(Some).chain([None]) {
            let mut places = Vec::new();
            for (k, (balls, numbers)) in balls.iter().zip(numbers).enumerate() {
                let of_number = balls.iter().zip(numbers).filter(|(_, n)| **n == number);
                places.extend(of_number.map(|(ball, _)| (k, ball)));
            }
            let named = places.iter().map(|(k, ball)| NamedFrame {
                name: &frames[*k].frame.name,
                time_s: frames[*k].frame.time_s,
                estimate: &ball.frame,
            });
            let named: Vec<NamedFrame<'_>> = named.collect();
            let file = orientations(&named, self.shown_in, spin.is_some() && number.is_some());
            if let (Some(spin), Some(_)) = (spin, number) {
                self.followed.push(Followed {
                    table: 0,
                    table_probability: 1.0,
                    frames: file.rows.len(),
                    identified: file.rows.iter().filter(|r| r.orientation.is_some()).count(),
                    spin: Some(spin_summary::of_rows(&file, spin)),
                });
            }
            for ((k, ball), row) in places.into_iter().zip(file.rows) {
                let json = ball_json(self.arguments, self.shown_in, number, ball);
                rows[k].push(Row {
                    row,
                    ball: number,
                    table: Some(ball.table),
                    flash: None,
                    json,
                });
            }
        }
        self.rows = rows;
    }

    /// The rows of strobed balls: in order of time, then what the likeliest hypothesis leaves out; the numbers of the balls.
    fn read_strobes(
        &mut self,
        balls: &[Vec<BallEstimate>],
        strobe: &Strobe,
    ) -> Vec<Vec<Option<usize>>> {
        let mut all_numbers = Vec::with_capacity(balls.len());
        for (frame, balls) in self.batch.frames.iter().zip(balls) {
            let found = strobe.read(balls, self.shown_in);
            let numbers = strobe_numbers(balls, &found);
            let lit = found.first().map_or(&[][..], |h| &h.lit[..]);
            let start_s = frame.frame.time_s.unwrap_or(0.0);
            let mut rows = Vec::new();
            for (at, (image, flash)) in lit.iter().enumerate() {
                let mut row = found[0].orientations.rows[at].clone();
                row.frame.clone_from(&frame.frame.name);
                row.time_s += start_s;
                let json = ball_json(self.arguments, self.shown_in, Some(at), &balls[*image]);
                rows.push(Row {
                    row,
                    ball: Some(at),
                    table: Some(balls[*image].table),
                    flash: Some(*flash),
                    json,
                });
            }
            let is_left = |k: &usize| lit.iter().all(|(image, _)| image != k);
            for (ball, number) in (0..balls.len())
                .filter(is_left)
                .map(|k| (&balls[k], numbers[k]))
            {
                let named = NamedFrame {
                    name: &frame.frame.name,
                    time_s: None,
                    estimate: &ball.frame,
                };
                let file = orientations(&[named], self.shown_in, false);
                let json = ball_json(self.arguments, self.shown_in, number, ball);
                rows.extend(file.rows.into_iter().map(|row| Row {
                    row,
                    ball: number,
                    table: Some(ball.table),
                    flash: None,
                    json: json.clone(),
                }));
            }
            self.rows.push(rows);
            let json = strobe_json(self.arguments, strobe, self.shown_in, &found, &numbers);
            self.strobes.push((found, json));
            all_numbers.push(numbers);
        }
        all_numbers
    }

    /// Where the times came from.
    #[cfg(feature = "plot")]
    pub fn times(&self) -> &TimeSource {
        &self.batch.times
    }

    /// A frame with its balls drawn on it.
    #[cfg(feature = "plot")]
    pub fn drawn(&self, k: usize, estimators: &[Estimator]) -> OverlayFrame {
        let frame = &self.batch.frames[k].frame;
        let balls = self.balls[k].iter().zip(&self.numbers[k]);
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

    /// Balls with an orientation.
    pub fn identified(&self) -> usize {
        let all = self.rows.iter().flatten();
        all.filter(|r| r.row.orientation.is_some()).count()
    }

    pub fn frames(&self) -> usize {
        self.rows.len()
    }

    /// The file of orientations with the columns ball, of several tables table, and of flashes flash.
    pub fn to_csv(&self) -> String {
        let has_tables = self.arguments.table.len() > 1;
        let has_flashes = !self.strobes.is_empty();
        let mut text = String::new();
        let line = |row: Option<&OrientationRow>| {
            let mut bytes = Vec::new();
            let mut writer = OrientationWriter::in_frame(&mut bytes, Some(self.shown_in));
            // Writing to memory cannot fail.
            let _ = row.map(|row| writer.write(row));
            let _ = writer.finish();
            String::from_utf8(bytes).unwrap_or_default()
        };
        let header = line(None);
        text.push_str(header.trim_end());
        text.push_str(",ball");
        text.push_str(if has_tables { ",table" } else { "" });
        text.push_str(if has_flashes { ",flash\n" } else { "\n" });
        let number = |n: Option<usize>| n.map_or(String::new(), |n| n.to_string());
        for row in self.rows.iter().flatten() {
            let whole = line(Some(&row.row));
            let own = whole.strip_prefix(&header).unwrap_or(&whole);
            text.push_str(own.trim_end_matches('\n'));
            text.push_str(&format!(",{}", number(row.ball)));
            if has_tables {
                let named = row.table.filter(|_| row.row.orientation.is_some());
                let name = named.map(|t| table_name(self.arguments, t));
                let name = name.unwrap_or_default();
                text.push_str(&format!(",{}", crate::files::csv::quoted(&name)));
            }
            if has_flashes {
                text.push_str(&format!(",{}", number(row.flash)));
            }
            text.push('\n');
        }
        text
    }

    pub fn to_json(&self) -> Value {
        let frames = self.batch.frames.iter().zip(&self.rows).enumerate();
        let frames = frames.map(|(k, (frame, rows))| {
            let mut json = json!({
                "frame": frame.frame.name,
                "time_s": frame.frame.time_s,
                "balls": rows.iter().map(|r| r.json.clone()).collect::<Vec<_>>(),
            });
            if let Some(words) = &frame.frame.unreadable {
                json["refusal"] = words.clone().into();
            }
            if let Some((_, strobe)) = self.strobes.get(k) {
                json["strobe"] = strobe.clone();
            }
            json
        });
        let balls = self.followed.iter().enumerate().map(|(number, ball)| {
            let mut json = json!({
                "ball": number,
                "table": table_name(self.arguments, ball.table),
                "table_probability": ball.table_probability,
                "frames": ball.frames,
                "identified": ball.identified,
            });
            match &ball.spin {
                Some(Ok(summary)) => json["spin"] = spin_summary::to_json(summary, self.shown_in),
                Some(Err(rejection)) => json["spin_refusal"] = rejection.to_string().into(),
                None => {}
            }
            json
        });
        json!({
            "detector": self.arguments.source.detector,
            "frame": self.shown_in,
            "frames": frames.collect::<Vec<_>>(),
            "balls": balls.collect::<Vec<_>>(),
            "identified": self.identified(),
            "times": self.batch.times,
        })
    }

    /// Summarizes the outcome on standard error.
    pub fn say(&self) {
        inputs::say_skipped(&self.batch.skipped);
        inputs::say_cut_short(&self.batch.cut_short);
        let frames = self.batch.frames.iter().zip(&self.rows).enumerate();
        for (k, (frame, rows)) in frames {
            let name = shown(&frame.frame.name);
            if let Some(why) = &frame.frame.unreadable {
                errln!("{why}");
                continue;
            }
            for row in rows {
                if let Some(why) = row.json["refusal"].as_str() {
                    let ball = row.ball.map_or(String::new(), |b| format!(", ball {b}"));
                    errln!("{name}{ball}: {why}");
                }
            }
            if let Some((found, _)) = self.strobes.get(k) {
                for line in self.strobe_lines(k, found) {
                    errln!("{name}: {line}");
                }
            }
        }
        let count: usize = self.rows.iter().map(Vec::len).sum();
        errln!(
            "{} of {count} balls in {} frames identified",
            self.identified(),
            self.rows.len()
        );
        // The spin of an exposure needs no times of frames.
        let times = inputs::times_words(&self.batch.times, self.rows.len());
        if let Some(words) = times.filter(|_| self.strobes.is_empty()) {
            errln!("times: {words}");
        }
        for (number, ball) in self.followed.iter().enumerate() {
            let table = match self.arguments.table.len() {
                1 => String::new(),
                _ => format!(
                    " is {} ({:.4}),",
                    table_name(self.arguments, ball.table),
                    ball.table_probability
                ),
            };
            let spin = match &ball.spin {
                Some(Ok(summary)) => spin_summary::lines(summary, self.shown_in).join("\n"),
                Some(Err(rejection)) => rejection.to_string(),
                None => String::new(),
            };
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
        let lit = first.lit.first().map(|(image, _)| &self.balls[k][*image]);
        if let Some(ball) = lit.filter(|_| self.arguments.table.len() > 1) {
            let name = table_name(self.arguments, ball.table);
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
        let golf = hypothesis.golf(self.shown_in);
        let spin = match (&hypothesis.spin, golf.filter(|_| self.arguments.golf)) {
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

fn table_name(arguments: &Arguments, table: usize) -> String {
    let path = arguments.table.get(table);
    path.map_or(String::new(), |path| path.display().to_string())
}

/// Sorts balls from left to right; what has no outline comes last.
pub(super) fn sort_from_left(balls: &mut [BallEstimate]) {
    let left = |ball: &BallEstimate| ball.circle().map_or(f64::INFINITY, |c| c.center.u);
    balls.sort_by(|a, b| left(a).total_cmp(&left(b)));
}

/// The numbers of an exposure's images: those of the likeliest hypothesis in order of time, then the others.
pub(super) fn strobe_numbers(
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

/// A ball of a frame.
pub(super) fn ball_json(
    arguments: &Arguments,
    shown_in: CameraFrame,
    number: Option<usize>,
    ball: &BallEstimate,
) -> Value {
    let frame = &ball.frame;
    let mut json = json!({
        "ball": number,
        "circle": ball.circle().map(|c| json!({
            "u": c.center.u, "v": c.center.v, "radius": c.radius,
        })),
        "outline_source": frame.outline.map(|o| o.source),
        "dots": frame.dots.len(),
        "matched": frame.matched(),
    });
    if arguments.table.len() > 1 {
        json["table"] = table_name(arguments, ball.table).into();
        json["table_probability"] = ball.tables.get(ball.table).copied().into();
    }
    output::add_pose(shown_in, frame, &mut json);
    json
}

/// The hypotheses of an exposure; `numbers` are those of its images.
pub(super) fn strobe_json(
    arguments: &Arguments,
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
                if arguments.golf {
                    json["golf"] = json!(h.golf(shown_in));
                }
            }
            Err(rejection) => json["spin_refusal"] = rejection.to_string().into(),
        }
        json
    });
    json!({ "hypotheses": hypotheses.collect::<Vec<_>>() })
}
