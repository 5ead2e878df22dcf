"""A study's machine in; an FMU, C, Modelica or JSON that other tools take, out."""
