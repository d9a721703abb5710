use spindoe::vision::*; use spindoe::vision::synth::{*,dataset::*}; use spindoe::pattern::Pattern;
fn main(){
 let pattern=Pattern::read_csv("designs/dots20/pattern.csv".as_ref()).unwrap();
 let cfg=SynthConfig{size_px:[60,60],fill:[0.85,1.0],dot_radius_rad:[0.07,0.11],misplacement_rad:[0.008,0.02],most_arc_rad:0.1,most_shift_px:1.0,defocus_px:[0.2,0.8],most_noise:2.0,bad_exposure:0.0,..Default::default()};
 let fr=frames(&pattern,&cfg,20261121,400).unwrap();
 let e=Estimator::new(&pattern,EstimatorConfig::default(),DetectorName::Cnn.build().unwrap()).unwrap();
 let mut ws=e.workspace(); let mut out=FrameEstimate::default();
 for (k,f) in fr.iter().enumerate(){
  e.estimate_frame(&f.image.to_gray(),None,None,&mut ws,&mut out);
  if let Err(r)=&out.outcome{
   let t=&f.truth; let c=out.circle.map(|c|((c.center.u-t.center.u)/t.radius_px,(c.center.v-t.center.v)/t.radius_px,c.radius/t.radius_px-1.0));
   println!("{k} {r} vis {} det>.5 {} >.15 {} circle {:?} dist {:?} logo {:?} r {:.1}",t.dots.iter().filter(|d|d.visible).count(),out.dots.iter().filter(|d|d.confidence>0.5).count(),out.dots.iter().filter(|d|d.confidence>0.15).count(),c.map(|c|(format!("{:.3} {:.3} {:.3}",c.0,c.1,c.2))),t.distance.map(|d|d as i32),t.logo,t.radius_px);
   f.image.resized(360,360).unwrap().write_png(format!("/tmp/fail/{k}.png").as_ref()).unwrap();
  }
 }
}
