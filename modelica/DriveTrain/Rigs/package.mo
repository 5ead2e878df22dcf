within DriveTrain;
package Rigs "Machines that are identified, simulated and exported"
end Rigs;
