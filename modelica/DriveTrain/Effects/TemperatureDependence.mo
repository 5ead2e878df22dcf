within DriveTrain.Effects;
model TemperatureDependence "Loss that changes with the measured temperature, as viscosity does"
  extends Interfaces.SegmentEffect(df0=friction.f0 * k * (temperature - mean));
  input Real temperature(unit="degC") "Temperature of the machine";
  parameter Real mean(unit="degC", min=-100, max=300, nominal=10) = 25 "Temperature at which f0 holds: the log's mean";
  parameter Real k(unit="1/K", min=-1, max=1, nominal=0.01) = 0 "Relative change a kelvin";
  annotation(__pycosim(size="k", measured="temperature", means="mean:temperature", place="system",
    needs="temperatures", experiment="repeat the same pass cold and warm"));
end TemperatureDependence;
