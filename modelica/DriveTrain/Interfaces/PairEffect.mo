within DriveTrain.Interfaces;
partial model PairEffect "Changes the law of one segment by the state of another, its partner"
  extends SegmentEffect;
  Friction partner "Port of the partner, to which nothing is added";
equation
  partner.dF = 0;
  partner.df0 = 0;
  partner.dv = 0;
  partner.ds = 0;
  partner.dmu = 0;
  partner.dT = 0;
end PairEffect;
