#include <bits/stdc++.h>
using namespace std;
struct Pose{double x,y,h;};
struct Ray{double a,d;bool k;double low,near_;bool rec;};
typedef vector<Ray> Rays;
struct Rec{char tag;Pose B,A,T;Rays rays;};
struct Run{string key;vector<vector<Rec>> segs;};
inline vector<Run> load(const char*fn){ifstream in(fn);vector<Run> out;string l;
 while(getline(in,l)){istringstream s(l);char t;s>>t;
  if(t=='K'){Run r;s>>r.key;r.segs.emplace_back();out.push_back(r);}
  else if(t=='F')out.back().segs.emplace_back();
  else{Rec r;r.tag=t;s>>r.B.x>>r.B.y>>r.B.h;if(t=='S')s>>r.A.x>>r.A.y>>r.A.h;s>>r.T.x>>r.T.y>>r.T.h;int n;s>>n;
   for(int i=0;i<n;i++){Ray q;int k;s>>q.a>>q.d>>k>>q.low>>q.near_;q.k=k!=0;q.rec=k==2;r.rays.push_back(q);}
   out.back().segs.back().push_back(r);}}
 return out;}
const double CELL=.15,BODY=.17,TRUSTED=3,MOST=4,LEAST=.2,NEARER=.6,FARTHER=1.5;
const int N=400,MID=200;
static double MARG=0,OCCW=1.5,FREEW=1,HOLD=0,BIAS=0,SOFT=0,FAR=0,PERS=0,PMOST=4,FLIP=0,IGN=0;struct Map{vector<float> e,f;Map():e(N*N,0),f(N*N,-1){}
 int cell(double x,double y){int a=(int)floor(x/CELL)+MID,b=(int)floor(y/CELL)+MID;a=min(max(a,3),N-4);b=min(max(b,3),N-4);return a*N+b;}
 void add(int c,double v,double d){double b=f[c];if(b<0||(d<NEARER*b&&!(HOLD>0&&v<0&&e[c]>0&&d>HOLD*b))){e[c]=min(v,PMOST);f[c]=d;}else if(d<FARTHER*b||(FAR>0&&v<0&&(v*=FAR,true))){if(IGN>0&&v>0&&e[c]<-IGN&&b<2){}else{double o=e[c];e[c]=min(PMOST,max(-MOST,o+v));if(FLIP>0&&v<=-FLIP&&o>0)e[c]=min((double)e[c],-.3);}f[c]=min(d,b);}}
 void set(int c,double v){e[c]=v;f[c]=0;}
 void stand(Pose p){for(int i=0;i<5;i++)for(int j=0;j<5;j++){double x=-BODY+i*BODY/2,y=-BODY+j*BODY/2;if(x*x+y*y<BODY*BODY)set(cell(p.x+x,p.y+y),-MOST);}}
 void enter(Pose p,const Rays&rays,double w){for(auto&r:rays){double t=p.h+r.a,dx=cos(t),dy=sin(t),sure=r.k?r.low:0;int last=-1;
  double lim=min(r.d*(1-MARG),TRUSTED)-.7*CELL,end=SOFT>0?min(r.d,TRUSTED)-.7*CELL:lim;for(double a=0;a<=end;a+=.6*CELL){int c=cell(p.x+a*dx,p.y+a*dy);if(c!=last){last=c;bool s=a<sure;add(c,-w*FREEW*(s?1:.4)*(a>lim?SOFT:1),s?max(a,r.near_):TRUSTED);}}
  if(r.d<TRUSTED)add(cell(p.x+r.d*(1-BIAS)*dx,p.y+r.d*(1-BIAS)*dy),w*(r.k?OCCW:.7),r.k?r.d:TRUSTED);}}
 bool occ(int c){return e[c]>LEAST;} bool fre(int c){return e[c]<-LEAST;}
};
inline double wrap(double a){a=fmod(a+M_PI,2*M_PI);if(a<0)a+=2*M_PI;return a-M_PI;}
inline Pose rel(Pose a,Pose b){double c=cos(a.h),s=-sin(a.h),dx=b.x-a.x,dy=b.y-a.y;return{c*dx-s*dy,s*dx+c*dy,b.h-a.h};}
inline Pose comp(Pose a,Pose r){double c=cos(a.h),s=sin(a.h);return{a.x+c*r.x-s*r.y,a.y+s*r.x+c*r.y,a.h+r.h};}
// relative truth: true pose in the frame in which the first scan's believed pose is right
inline Pose truth(Pose a0,Pose t0,Pose t){return comp(a0,rel(t0,t));}
struct Err{double e,h;};
struct Judge{map<int,vector<Err>> E;void add(int n,Pose p,Pose t){E[min(n/4,4)].push_back({hypot(p.x-t.x,p.y-t.y),fabs(wrap(p.h-t.h))*180/M_PI});}
 void run(int&n,const vector<Pose>&ps,const vector<Pose>&ts){if(ps.empty())return;vector<double> o;for(size_t i=0;i<ps.size();i++)o.push_back(wrap(ps[i].h-ts[i].h-(ps[0].h-ts[0].h)));
  sort(o.begin(),o.end());double off=ps[0].h-ts[0].h+o[o.size()/2];Pose a0={ps[0].x,ps[0].y,ts[0].h+off};
  for(size_t i=0;i<ps.size();i++)add(++n,ps[i],truth(a0,ts[0],ts[i]));}
 void print(const char*name){printf("%-34s",name);for(auto&[b,v]:E){vector<double> e,h;for(auto&x:v)e.push_back(x.e),h.push_back(x.h);sort(e.begin(),e.end());sort(h.begin(),h.end());
  auto q=[](vector<double>&v,double f){return v[min(v.size()-1,(size_t)(v.size()*f))];};
  printf("|%3zu %.2f %.2f %.2f h%3.0f %3.0f ",e.size(),q(e,.5),q(e,.8),q(e,.9),q(h,.8),q(h,.9));}puts("");}};
typedef array<double,4> Seg;
inline map<string,vector<Seg>> loadgeo(const char*fn){ifstream in(fn);map<string,vector<Seg>> g;string t,k;int n;while(in>>t>>k>>n){auto&v=g[k];v.resize(n);for(auto&s:v)in>>s[0]>>s[1]>>s[2]>>s[3];}return g;}
inline double castray(const vector<Seg>&segs,double x,double y,double a){double dx=cos(a),dy=sin(a),r=99;for(auto&s:segs){double ex=s[2]-s[0],ey=s[3]-s[1],den=dx*ey-dy*ex;if(fabs(den)<1e-9)continue;double t=((s[0]-x)*ey-(s[1]-y)*ex)/den,u=((s[0]-x)*dy-(s[1]-y)*dx)/den;if(t>0&&u>=0&&u<=1&&t<r)r=t;}return r;}
