within DriveTrain;
package Examples "Small models to start from"
end Examples;
