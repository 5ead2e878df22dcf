within DriveTrain;
package Components "Parts of a drive train"
end Components;
