within DriveTrain;
package Effects "Physical effects that a model may lack, one file each"
end Effects;
