//! Clips of one ball by several cameras, as one clip.
//!
//! ```text
//! each      every camera's clip by itself, as any clip                                   (run)
//! agree     do the cameras agree as a whole: places, clocks, which clip is whose         (agreement)
//! pair      frames of one time: the nearest within half a step, moved there by the spin  (pairs)
//! again     a frame that one camera misses, where another expects it                     (Prior)
//! fuse      one measurement a time, with its chi2                                        (fuse)
//! spin      of the fused orientations
//! ```
//!
//! What comes of it is in the rig's frame, the first camera's ([`Rig`]). Cameras whose differences are larger than
//! their covariances say are widened by as much. Frames that then differ more than once in a thousand times by chance are not fused: without
//! the camera that is off where others agree, else by the surer one, with the confidence that is left of it, or not at all.
//!
//! Guarantees: a frame helps another camera's only where it needed no hint itself; no frame is fused with another's guess
//! of it, since what is found with a hint is fitted to that camera's own dots. Not guaranteed: anything of cameras that
//! disagree as a whole: none of their frames is answered, and [`RigDoubt`] says why.

mod agreement;
mod doubt;
mod files;
mod fuse;
mod pairs;
mod retry;

use self::agreement::{Compared, compare};
use self::fuse::{CameraReading, Fused, Widening, chance, fuse, pose_of};
use self::pairs::{CameraTrack, Group, by_number, by_time, reach_s, step_s};
use super::sequence::{ImageResults, ImageWork, SequenceConfig, TRUSTED, estimate_spin};
use crate::error::{Error, Result};
use crate::geometry::CameraFrame;
use crate::spin::orientations::{BallColumns, Orientations};
use crate::spin::{Fit, SpinRejection};
use crate::stats::{SUREST, consensus};
use crate::vision::estimator::Estimator;
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::optics::camera::Camera;
use crate::vision::optics::rig::Rig;

pub use self::agreement::{CameraAgreement, ClockCheck};
pub use self::doubt::RigDoubt;
pub use self::files::{RigClip, run_rig, run_rig_sources};

/// What a camera's frames were estimated with, and what came of it.
#[derive(Debug)]
pub struct CameraClip<'a> {
    /// With this camera's intrinsics.
    pub estimator: &'a Estimator,
    /// Names of the frames; none where they have none.
    pub names: Vec<String>,
    /// Their times by the camera's own clock, seconds, ascending; `None` where not all have one.
    pub times_s: Option<Vec<f64>>,
    /// Each frame's estimate, in the camera's frame.
    pub frames: Vec<FrameEstimate>,
}

/// How a time's frames became one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fusion {
    /// Of several cameras that agree.
    Fused {
        /// Their squared differences over the variances.
        chi2: f64,
        /// Degrees of freedom.
        freedom: usize,
    },
    /// Of one camera.
    Single,
    /// Cameras disagreed, and what remains was sure enough.
    Chosen {
        /// As in [`Fusion::Fused`], of all.
        chi2: f64,
        /// Degrees of freedom.
        freedom: usize,
    },
    /// Cameras disagreed, and none was sure enough.
    Disagreed {
        /// As in [`Fusion::Fused`], of all.
        chi2: f64,
        /// Degrees of freedom.
        freedom: usize,
    },
    /// No camera has an orientation.
    Unanswered,
}

/// How well the cameras of one time agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// Their squared differences over the variances.
    pub chi2: f64,
    /// Degrees of freedom.
    pub freedom: usize,
}

/// A time of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigFrame {
    /// The name of the first camera's frame that it has.
    pub name: String,
    /// Seconds, by the first camera's clock.
    pub time_s: Option<f64>,
    /// The number of each camera's frame, where it has one.
    pub members: Vec<Option<usize>>,
    /// How many cameras' orientations it is of.
    pub cameras: usize,
    /// How it was fused.
    pub fusion: Fusion,
    /// The first camera's estimate, with the pose and the position of all cameras in its frame.
    pub estimate: FrameEstimate,
    /// Dots that all its cameras have seen, and those with a name.
    pub dots: [usize; 2],
}

/// What several cameras say together.
#[derive(Debug, Clone)]
pub struct RigOutcome {
    /// In order of time.
    pub frames: Vec<RigFrame>,
    /// How each camera but the first agrees with it; `None` where too little was seen by both.
    pub agreement: Vec<Option<CameraAgreement>>,
    /// What is wrong with the cameras as a whole.
    pub doubts: Vec<RigDoubt>,
    /// Frames of single cameras that others settled.
    pub settled: usize,
}

/// What is to be known of frames of several cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigConfig {
    /// How frames help each other.
    pub sequence: SequenceConfig,
    /// Whether no frame is looked at again.
    pub independent: bool,
    /// Minimum probability of a pose that is accepted.
    pub min_confidence: f64,
}

/// The pose that cameras share, or why there is none.
struct Joined {
    fusion: Fusion,
    /// Who agrees, by their numbers.
    used: Vec<usize>,
    reading: Option<CameraReading>,
    confidence: f64,
}

/// Fuses the clips of a rig's cameras, in their order. `on_images` does the work on images of a camera with these numbers, which
/// ascend, and returns what comes of it.
///
/// # Errors
/// [`Error::Argument`] where clips and cameras are not as many, an estimator has no intrinsics, or frames without times are not as
/// many for each camera; within, those of `on_images`.
pub fn combine<E>(
    rig: &Rig,
    config: &RigConfig,
    clips: &mut [CameraClip<'_>],
    mut on_images: impl FnMut(usize, &[usize], &ImageWork<'_>) -> ImageResults<E>,
) -> Result<std::result::Result<RigOutcome, E>> {
    check(rig, clips)?;
    let mut found = Assembly::new(rig, config, clips);
    if !found.is_contradicted() && !config.independent {
        found.settled = match retry::missed(&found, clips, &mut on_images) {
            Ok(settled) => settled,
            Err(error) => return Ok(Err(error)),
        };
    }
    Ok(Ok(found.outcome(clips)))
}

fn check(rig: &Rig, clips: &[CameraClip<'_>]) -> Result<()> {
    if clips.len() != rig.cameras().len() {
        let problem = format!(
            "expected a clip for each of {} cameras, found {}",
            rig.cameras().len(),
            clips.len()
        );
        return Err(Error::argument("clips", problem));
    }
    for (camera, clip) in rig.cameras().iter().zip(clips) {
        let CameraModel::Known(Camera::Perspective(_)) = clip.estimator.config().camera else {
            let problem = format!(
                "{}: expected a camera whose intrinsics are known",
                camera.name
            );
            return Err(Error::argument("camera", problem));
        };
    }
    let is_timed = clips.iter().all(|clip| clip.times_s.is_some());
    let first = clips[0].frames.len();
    if let Some(k) = clips
        .iter()
        .position(|clip| !is_timed && clip.frames.len() != first)
    {
        let problem = format!(
            "expected times, or as many frames of each camera, found {first} of {} and {} of {}",
            rig.cameras()[0].name,
            clips[k].frames.len(),
            rig.cameras()[k].name
        );
        return Err(Error::argument("frames", problem));
    }
    Ok(())
}

/// The cameras of a rig as they are put together.
struct Assembly<'a> {
    rig: &'a Rig,
    config: &'a RigConfig,
    is_timed: bool,
    /// Whose frames count: not those of a mirrored camera or of another ball.
    counts: Vec<bool>,
    /// Of each camera, by the first one's clock, in order of all its frames that say anything.
    tracks: Vec<CameraTrack>,
    /// What is added to a camera's times.
    delays_s: Vec<f64>,
    widenings: Vec<Widening>,
    compared: Vec<Option<Compared>>,
    doubts: Vec<RigDoubt>,
    settled: usize,
}

impl Joined {
    /// No orientation.
    fn without(fusion: Fusion, reading: Option<CameraReading>) -> Self {
        Self {
            fusion,
            used: Vec::new(),
            reading,
            confidence: 0.0,
        }
    }
}

impl<'a> Assembly<'a> {
    fn new(rig: &'a Rig, config: &'a RigConfig, clips: &[CameraClip<'_>]) -> Self {
        let count = clips.len();
        let mut this = Self {
            rig,
            config,
            is_timed: clips.iter().all(|clip| clip.times_s.is_some()),
            counts: vec![true; count],
            tracks: Vec::new(),
            delays_s: rig.cameras().iter().map(|c| c.clock_offset_s).collect(),
            widenings: vec![Widening::default(); count],
            compared: vec![None; count],
            doubts: Vec::new(),
            settled: 0,
        };
        for (k, clip) in clips.iter().enumerate() {
            if let Some(doubt) = doubt::of_camera(&rig.cameras()[k].name, &clip.frames) {
                this.doubts.push(doubt);
                this.counts[k] = false;
            }
        }
        this.tracks = this.tracks_of(clips);
        for k in 1..count {
            this.compared[k] = compare(&this.tracks[0], &this.tracks[k]);
            if let Some(compared) = this.compared[k] {
                this.delays_s[k] += compared.delay_s;
                this.widenings[k] = compared.widening;
            }
        }
        // What differs is of both: the first camera's errors are larger by what they are on average.
        let all: Vec<[f64; 2]> = this
            .compared
            .iter()
            .flatten()
            .map(|c| c.widening.factors)
            .collect();
        if !all.is_empty() {
            let mean = |at: usize| all.iter().map(|f| f[at]).sum::<f64>() / all.len() as f64;
            this.widenings[0].factors = [mean(0), mean(1)];
        }
        doubt::of_rig(&mut this, clips);
        for (track, compared) in this.tracks.iter_mut().zip(&this.compared) {
            track.delay(compared.map_or(0.0, |c| c.delay_s));
        }
        this
    }

    /// Whether nothing that the cameras say together can be believed.
    fn is_contradicted(&self) -> bool {
        self.doubts.iter().any(RigDoubt::is_of_all)
    }

    /// What a camera's frame says in the rig's frame.
    fn reading(&self, camera: usize, estimate: &FrameEstimate) -> Option<CameraReading> {
        let to_rig = self.rig.cameras()[camera].to_rig();
        CameraReading::of(estimate, &to_rig).filter(|_| self.counts[camera])
    }

    fn tracks_of(&self, clips: &[CameraClip<'_>]) -> Vec<CameraTrack> {
        let track = |(k, clip): (usize, &CameraClip<'_>)| {
            let timed = clip.times_s.iter().flatten().zip(&clip.frames);
            let posed = timed.filter_map(|(t, frame)| {
                let trusted = frame.pose()?.confidence >= TRUSTED;
                Some((*t, self.reading(k, frame).filter(|_| trusted)?))
            });
            let fit = self.spin_of(k, clip);
            let readings = posed.collect();
            let mut track = CameraTrack { readings, fit };
            track.delay(self.delays_s[k]);
            track
        };
        clips.iter().enumerate().map(track).collect()
    }

    /// The spin of a camera's frames, in the rig's frame.
    fn spin_of(&self, camera: usize, clip: &CameraClip<'_>) -> Option<Fit> {
        let times = clip.times_s.as_ref().filter(|_| self.counts[camera])?;
        let fit = estimate_spin(&self.config.sequence, times, &clip.frames).ok()?;
        Some(fit.turned(&self.rig.cameras()[camera].to_rig().rotation))
    }

    /// The frames of one time.
    fn groups(&self, clips: &[CameraClip<'_>]) -> Vec<Group> {
        if !self.is_timed {
            let counts: Vec<usize> = clips.iter().map(|clip| clip.frames.len()).collect();
            return by_number(&counts);
        }
        let times = clips.iter().zip(&self.delays_s).map(|(clip, delay_s)| {
            let own = clip.times_s.iter().flatten();
            own.map(|t| t + delay_s).collect::<Vec<f64>>()
        });
        let times: Vec<Vec<f64>> = times.collect();
        let steps = times.iter().map(|t| step_s(t)).filter(|s| *s > 0.0);
        let step = steps.reduce(f64::min).unwrap_or(0.0);
        by_time(&times, reach_s(step, self.motion().is_some()))
    }

    /// Whose spin the ball is moved by: that of the most frames.
    fn motion(&self) -> Option<&CameraTrack> {
        let known = self.tracks.iter().filter(|track| track.fit.is_some());
        known.max_by_key(|track| track.fit.map_or(0, |fit| fit.inliers))
    }

    /// What each camera says at the time of a group, by their numbers.
    fn readings(&self, group: &Group, clips: &[CameraClip<'_>]) -> Vec<(usize, CameraReading)> {
        let members = group.members.iter().enumerate();
        let reading = |(k, frame): (usize, &Option<usize>)| {
            let (frame, clip) = ((*frame)?, &clips[k]);
            let own = self.reading(k, &clip.frames[frame])?;
            let widened = own.widened(&self.widenings[k]);
            let seen_s = clip.times_s.as_ref().map(|t| t[frame] + self.delays_s[k]);
            let by_s = group.time_s.zip(seen_s).map_or(0.0, |(at, seen)| at - seen);
            let drift = self.motion().filter(|_| by_s != 0.0);
            let drift = drift.and_then(|track| track.drift(group.time_s?));
            Some((
                k,
                drift.map_or(widened, |drift| widened.moved(by_s, &drift)),
            ))
        };
        members.filter_map(reading).collect()
    }

    /// What the readings of one time are together.
    fn join(&self, readings: &[(usize, CameraReading)]) -> Joined {
        let posed = readings.iter().filter(|(_, r)| r.rotation.is_some());
        let mut agreeing: Vec<(usize, CameraReading)> = posed.copied().collect();
        let mut others: Vec<CameraReading> = Vec::new();
        let fused_of =
            |of: &[(usize, CameraReading)]| fuse(&of.iter().map(|(_, r)| *r).collect::<Vec<_>>());
        let Some(all) = fused_of(&agreeing) else {
            return self.centers(readings);
        };
        let mut fused = all;
        while !fused.agrees() && agreeing.len() > 1 {
            let without = |k: usize| {
                let rest = agreeing.iter().enumerate().filter(|(i, _)| *i != k);
                rest.map(|(_, r)| *r).collect::<Vec<_>>()
            };
            // Of two the surer stays, and one that needed a hint goes first; of more those that agree best.
            let cost = |k: &usize| match agreeing.len() {
                2 => agreeing[*k].1.confidence - f64::from(u8::from(agreeing[*k].1.hinted)),
                _ => fused_of(&without(*k)).map_or(f64::INFINITY, |f| f.chi2),
            };
            let worst = (0..agreeing.len()).min_by(|a, b| cost(a).total_cmp(&cost(b)));
            let worst = worst.unwrap_or(0);
            others.push(agreeing.remove(worst).1);
            let Some(next) = fused_of(&agreeing) else {
                break;
            };
            fused = next;
        }
        let confidence = confidence(&agreeing, &others);
        let (chi2, freedom) = (all.chi2, all.freedom);
        let is_sure = confidence >= self.config.min_confidence;
        let fusion = match (others.is_empty(), agreeing.len(), is_sure) {
            (true, 1, _) => Fusion::Single,
            (true, ..) => Fusion::Fused { chi2, freedom },
            (false, _, true) => Fusion::Chosen { chi2, freedom },
            (false, _, false) => Fusion::Disagreed { chi2, freedom },
        };
        let used = agreeing.iter().map(|(k, _)| *k).collect();
        if matches!(fusion, Fusion::Disagreed { .. }) {
            return Joined::without(fusion, None);
        }
        let outlines = readings.iter().filter(|(_, r)| r.rotation.is_none());
        let reading = with_centers(fused, outlines.map(|(_, r)| *r));
        Joined {
            fusion,
            used,
            reading: Some(reading),
            confidence,
        }
    }

    /// The center of readings without an orientation: of outlines that agree, or of the only one.
    fn centers(&self, readings: &[(usize, CameraReading)]) -> Joined {
        let all: Vec<CameraReading> = readings.iter().map(|(_, r)| *r).collect();
        let fused = fuse(&all).filter(Fused::agrees);
        Joined::without(Fusion::Unanswered, fused.map(|fused| fused.reading))
    }

    fn outcome(self, clips: &[CameraClip<'_>]) -> RigOutcome {
        let is_contradicted = self.is_contradicted();
        let frames = self.groups(clips).into_iter().map(|group| {
            let joined = match is_contradicted {
                true => Joined::without(Fusion::Unanswered, None),
                false => self.join(&self.readings(&group, clips)),
            };
            self.frame(group, &joined, clips)
        });
        let frames = frames.collect();
        let agreement = self.compared[1..].iter();
        RigOutcome {
            frames,
            agreement: agreement.map(|c| c.map(|c| c.agreement)).collect(),
            doubts: self.doubts,
            settled: self.settled,
        }
    }

    /// A frame of what the cameras say together.
    fn frame(&self, group: Group, joined: &Joined, clips: &[CameraClip<'_>]) -> RigFrame {
        let member = |k: usize| group.members[k].map(|frame| &clips[k].frames[frame]);
        let all = (0..clips.len()).filter_map(member);
        let mut estimate = member(0).cloned().unwrap_or_default();
        let posed = joined.used.iter().filter_map(|k| member(*k)?.pose());
        let surest = posed.reduce(|a, b| if b.confidence > a.confidence { b } else { a });
        let pose = joined.reading.zip(surest);
        let pose = pose.and_then(|(reading, pose)| pose_of(&reading, pose, joined.confidence));
        estimate.outcome = match (pose, joined.fusion) {
            (Some(pose), _) => Ok(pose),
            (None, Fusion::Disagreed { chi2, freedom }) => {
                Err(FrameRejection::CamerasDisagree { chi2, freedom })
            }
            (None, _) if self.is_contradicted() => Err(FrameRejection::CamerasContradict),
            (None, _) => {
                let mut reasons = all.filter_map(|frame| frame.outcome.err());
                Err(reasons.next().unwrap_or(FrameRejection::NotProcessed))
            }
        };
        estimate.outline_position = joined.reading.and_then(|reading| reading.position());
        let used = || joined.used.iter().filter_map(|k| member(*k));
        let name = (0..clips.len()).find_map(|k| clips[k].names.get(group.members[k]?).cloned());
        RigFrame {
            name: name.unwrap_or_default(),
            time_s: group.time_s,
            cameras: joined.used.len(),
            fusion: joined.fusion,
            dots: [
                used().map(|frame| frame.dots.len()).sum(),
                used().map(FrameEstimate::matched).sum(),
            ],
            members: group.members,
            estimate,
        }
    }
}

/// A pose with the centers of outlines whose dots are not named, as far as they agree with it: what is round may be another thing.
fn with_centers(fused: Fused, outlines: impl Iterator<Item = CameraReading>) -> CameraReading {
    let mut reading = fused.reading;
    for outline in outlines {
        let both = fuse(&[reading, outline]).filter(Fused::agrees);
        reading = both.map_or(reading, |both| CameraReading {
            confidence: reading.confidence,
            hinted: reading.hinted,
            ..both.reading
        });
    }
    reading
}

/// The probability of an orientation, by those that agree with it and those that do not. What a hint decided is no answer of its
/// own.
fn confidence(agreeing: &[(usize, CameraReading)], others: &[CameraReading]) -> f64 {
    let own = agreeing.iter().filter(|(_, r)| !r.hinted);
    let mut free: Vec<f64> = own.map(|(_, r)| r.confidence).collect();
    if free.is_empty() {
        free = vec![
            agreeing
                .iter()
                .map(|(_, r)| r.confidence)
                .fold(0.0, f64::max),
        ];
    }
    let others = others.iter().filter(|r| !r.hinted);
    let others: Vec<f64> = others.map(|r| r.confidence).collect();
    let readings: Vec<CameraReading> = agreeing.iter().map(|(_, r)| *r).collect();
    consensus(&free, &others, chance(&readings)).min(SUREST)
}

impl Fusion {
    /// How well several cameras agree.
    pub fn misfit(&self) -> Option<Misfit> {
        match *self {
            Self::Fused { chi2, freedom }
            | Self::Chosen { chi2, freedom }
            | Self::Disagreed { chi2, freedom } => Some(Misfit { chi2, freedom }),
            Self::Single | Self::Unanswered => None,
        }
    }
}

impl RigOutcome {
    /// Frames with an orientation.
    pub fn answered(&self) -> usize {
        self.frames
            .iter()
            .filter(|f| f.estimate.pose().is_some())
            .count()
    }

    /// Frames whose cameras disagreed.
    pub fn disagreed(&self) -> usize {
        let is_so =
            |f: &&RigFrame| matches!(f.fusion, Fusion::Chosen { .. } | Fusion::Disagreed { .. });
        self.frames.iter().filter(is_so).count()
    }

    /// The orientations as a file, by the axes of `frame`.
    pub fn orientations(&self, frame: CameraFrame) -> Orientations {
        let named = self.frames.iter().map(|f| super::NamedFrame {
            name: &f.name,
            time_s: f.time_s,
            estimate: &f.estimate,
        });
        let named: Vec<_> = named.collect();
        let mut file = super::orientations(&named, frame, true);
        for (row, frame) in file.rows.iter_mut().zip(&self.frames) {
            row.cameras = Some(frame.cameras);
            if frame.cameras > 0 {
                [row.dots, row.matched] = frame.dots.map(Some);
            }
        }
        file.columns = BallColumns {
            cameras: true,
            ..file.columns
        };
        file
    }

    /// The spin of the fused orientations, in the rig's frame.
    ///
    /// # Errors
    /// A [`SpinRejection`] where frames have no times, too few have an orientation, or they agree on nothing.
    pub fn spin(&self, config: &SequenceConfig) -> std::result::Result<Fit, SpinRejection> {
        let file = self.orientations(CameraFrame::default());
        let config = file.spin_config(config.spin);
        crate::spin::robust::RobustEstimator::new(config).fit(&file.measurements())
    }
}
