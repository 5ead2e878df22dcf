within DriveTrain;
package UsersGuide "Conventions"
end UsersGuide;
