within DriveTrain;
package Interfaces "Connectors, and the partial models that effects and components extend"
end Interfaces;
