#include "core.h"
double dseg(double x,double y,const Seg&s){double dx=s[2]-s[0],dy=s[3]-s[1],L=dx*dx+dy*dy,t=L?max(0.,min(1.,((x-s[0])*dx+(y-s[1])*dy)/L)):0;return hypot(x-s[0]-t*dx,y-s[1]-t*dy);}
static map<string,double> Q={{"w",.5},{"occ",1.5},{"turn",99},{"use",1},{"near",2},{"wmost",4},{"every",1},{"b",0},{"hidden",1},{"step",0},{"mg",0},{"occw",1.5},{"ang",9}};
struct M2:Map{
 void enterw(Pose p,const Rays&rays,double w,double occ,double hid){for(auto&r:rays){double t=p.h+r.a,dx=cos(t),dy=sin(t),sure=r.k?r.low:0;int last=-1;
  double end=min(r.d-max(.7*CELL,Q["mg"]*r.d),TRUSTED);for(double a=0;a<=end;a+=.6*CELL){int c=cell(p.x+a*dx,p.y+a*dy);if(c!=last){last=c;bool s=a<sure;add(c,-w*(s?1:.4),s?max(a,r.near_):TRUSTED);}}
  if(r.d<TRUSTED)add(cell(p.x+r.d*dx,p.y+r.d*dy),w*(r.k?occ:hid),r.k?r.d:TRUSTED);}}
};
int main(int c,char**v){vector<const char*> fs;string nm;for(int i=1;i<c;i++){string a=v[i];auto e=a.find('=');if(e!=string::npos){Q[a.substr(0,e)]=stod(a.substr(e+1));nm+=a+" ";}else fs.push_back(v[i]);}
 long tot=0,fal=0,wallfree=0,wallseen=0,freec=0,seal=0;
 for(auto f:fs){auto runs=load(f);auto geo=loadgeo((string(f)+".geo").c_str());
 for(auto&r:runs){auto&sg=geo[r.key];for(auto&g:r.segs){M2 m;double lh=0;int cnt=0;Pose le={-9,-9,0};
  for(auto&x:g){Pose p=x.T;p.x-=5;p.y-=5;Rays rs;for(auto&q:x.rays)if(!q.rec&&(q.k||Q["hidden"]>0||x.tag=='S'))rs.push_back(q);
   if(x.tag=='S')m.enterw(p,rs,1,Q["occw"],.7);
   else{double dh=fabs(wrap(x.T.h-lh));lh=x.T.h;cnt++;if(hypot(p.x-le.x,p.y-le.y)<Q["step"]&&fabs(wrap(p.h-le.h))<Q["ang"]){m.stand(p);continue;}le=p;if(Q["use"]&&dh<Q["turn"]&&cnt%(int)Q["every"]==0)m.enterw(p,rs,Q["w"],Q["occ"],Q["hidden"]>0?.7:0);}
   m.stand(p);}
  for(int i=0;i<N;i++)for(int j=0;j<N;j++){int cc=i*N+j;float e=m.e[cc];if(fabs(e)<=LEAST)continue;double X=(i-MID+.5)*CELL+5,Y=(j-MID+.5)*CELL+5;double d=9;for(auto&s:sg)d=min(d,dseg(X,Y,s));
   if(e>LEAST){tot++;fal+=d>.3;if(d>.3){int fr=0;const int B[4]={N,-N,1,-1};for(int o:B)fr+=m.e[cc+o]<-LEAST;seal+=fr>=3;}}else{freec++;}
   if(d<.05){wallseen++;wallfree+=e<-LEAST;}}
 }}}
 printf("%-40s occupied %5ld false %4ld (isolated %ld); free %ld; wall cells %ld of which free %ld (%.3f)\n",nm.c_str(),tot,fal,seal,freec,wallseen,wallfree,double(wallfree)/wallseen);}
